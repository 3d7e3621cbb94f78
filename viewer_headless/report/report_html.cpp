#include <algorithm>

#include "viewer_headless/report/assets.hpp"
#include "viewer_headless/report/report.hpp"
#include "viewer_headless/summary.hpp"

namespace hp2 {

namespace {

std::string base64(const std::string& text) {
  static const char* const kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  const auto byte = [&](std::size_t i) { return static_cast<unsigned>(static_cast<unsigned char>(text[i])); };
  std::string out;
  for (std::size_t i = 0; i < text.size(); i += 3) {
    const std::size_t left = std::min<std::size_t>(3, text.size() - i);
    unsigned v = byte(i) << 16;
    if (left > 1) v |= byte(i + 1) << 8;
    if (left > 2) v |= byte(i + 2);
    for (std::size_t k = 0; k < 4; ++k) out += k <= left ? kDigits[v >> (18 - 6 * k) & 63] : '=';
  }
  return out;
}

// Inside a script element nothing may look like its end, or like a comment.
std::string for_script(std::string json) {
  std::string out;
  for (const char c : json) out += c == '<' ? std::string("\\u003c") : std::string(1, c);
  return out;
}

}  // namespace

std::string report_html(const nlohmann::ordered_json& data, const std::string& map_jpeg) {
  std::string page =
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
      // Nothing is loaded from anywhere, whatever a name in the data may hold.
      "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; script-src "
      "'unsafe-inline'; "
      "style-src 'unsafe-inline'; img-src data:\">\n<title>HP2-SLAM report</title>\n<style>\n";
  page += report_assets::style() + "</style>\n</head>\n<body>\n<main id=\"page\"></main>\n";
  page += "<noscript>This report draws its charts with JavaScript.</noscript>\n";
  if (!map_jpeg.empty()) {
    page += "<img id=\"map-picture\" alt=\"Map seen from above\" src=\"data:image/jpeg;base64," +
            base64(map_jpeg) + "\">\n";
  }
  page += "<script type=\"application/json\" id=\"data\">" + for_script(dump(data, -1)) + "</script>\n";
  page += "<script>\n" + report_assets::chart_library() + "\n</script>\n";
  page += "<script>\n" + report_assets::script() + "\n</script>\n</body>\n</html>\n";
  return page;
}

}  // namespace hp2
