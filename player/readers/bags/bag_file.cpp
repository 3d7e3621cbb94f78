#include "player/readers/bags/bag_file.hpp"

#include <algorithm>
#include <utility>

namespace hp2 {

std::string common_type_name(const std::string& type) {
  const std::size_t at = type.find("/msg/");
  return at == std::string::npos ? type : type.substr(0, at) + type.substr(at + 4);
}

std::size_t topic_index(std::vector<BagTopic>& topics, const std::string& name, const std::string& type,
                        Encoding encoding, const WantedTypes& wanted) {
  const std::string common = common_type_name(type);
  for (std::size_t i = 0; i < topics.size(); ++i)
    if (topics[i].name == name && topics[i].type == common && topics[i].encoding == encoding) return i;
  BagTopic topic;
  topic.name = name;
  topic.type = common;
  topic.encoding = encoding;
  topic.wanted = wanted(common);
  topics.push_back(std::move(topic));
  return topics.size() - 1;
}

void add_message(BagTopic& topic, const MessageRef& ref) {
  topic.first_us = topic.count == 0 ? ref.utime : std::min(topic.first_us, ref.utime);
  topic.last_us = topic.count == 0 ? ref.utime : std::max(topic.last_us, ref.utime);
  ++topic.count;
  if (topic.wanted) topic.refs.push_back(ref);
}

void drop_repeated(BagTopic& topic) {
  auto& refs = topic.refs;
  const auto place = [](const MessageRef& r) { return std::pair(r.chunk, r.at); };
  std::stable_sort(refs.begin(), refs.end(),
                   [&](const MessageRef& a, const MessageRef& b) { return place(a) < place(b); });
  refs.erase(std::unique(refs.begin(), refs.end(),
                         [&](const MessageRef& a, const MessageRef& b) { return place(a) == place(b); }),
             refs.end());
  if (topic.wanted) topic.count = refs.size();
}

}  // namespace hp2
