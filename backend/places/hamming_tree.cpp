#include "backend/places/hamming_tree.hpp"

#include <algorithm>
#include <tuple>

namespace hp2 {
namespace {

inline bool bit_of(const Descriptor& d, int bit) {
  return (d[static_cast<std::size_t>(bit >> 6)] >> (bit & 63)) & 1;
}

// A split that leaves less than this share on one side brings nothing.
constexpr double kMinShare = 0.1;

// The inner loop: without the POPCNT instruction several times as slow.
HP2_COUNTS_BITS void scan_leaf(const TreeEntry* entries, std::size_t n, const Descriptor& query,
                               int max_distance, std::vector<TreeMatch>& matches) {
  for (std::size_t i = 0; i < n; ++i) {
    const int distance = __builtin_popcountll(entries[i].descriptor[0] ^ query[0]) +
                         __builtin_popcountll(entries[i].descriptor[1] ^ query[1]) +
                         __builtin_popcountll(entries[i].descriptor[2] ^ query[2]) +
                         __builtin_popcountll(entries[i].descriptor[3] ^ query[3]);
    if (distance <= max_distance) matches.push_back({entries[i].submap, entries[i].feature, distance});
  }
}

}  // namespace

HammingTree::HammingTree(int leaf_capacity, int leaves_per_tree)
    : leaf_capacity_(static_cast<std::size_t>(std::max(leaf_capacity, 2))),
      leaves_per_tree_(std::max(leaves_per_tree, 1)) {
  for (Tree& tree : trees_) {
    tree.nodes.push_back({-1, 0});
    tree.leaves.emplace_back();
    tree.leaves[0].split_at = leaf_capacity_;
  }
}

void HammingTree::insert(const TreeEntry& entry) {
  for (int t = 0; t < kTrees; ++t) {
    Tree& tree = trees_[static_cast<std::size_t>(t)];
    std::uint64_t asked[4] = {0, 0, 0, 0};
    std::int32_t node = 0;
    while (tree.nodes[static_cast<std::size_t>(node)].bit >= 0) {
      const Node& n = tree.nodes[static_cast<std::size_t>(node)];
      asked[n.bit >> 6] |= std::uint64_t{1} << (n.bit & 63);
      node = n.child + bit_of(entry.descriptor, n.bit);
    }
    Leaf& leaf = tree.leaves[static_cast<std::size_t>(tree.nodes[static_cast<std::size_t>(node)].child)];
    leaf.entries.push_back(entry);
    if (leaf.entries.size() >= leaf.split_at) split(tree, t, node, asked);
  }
  ++size_;
}

void HammingTree::split(Tree& tree, int which, std::int32_t node, std::uint64_t asked[4]) {
  const auto leaf_index = static_cast<std::size_t>(tree.nodes[static_cast<std::size_t>(node)].child);
  const std::vector<TreeEntry>& entries = tree.leaves[leaf_index].entries;
  const std::size_t n = entries.size();
  int best_bit = -1;
  std::size_t best_ones = 0, best_imbalance = n;
  for (int bit = which; bit < 256;
       bit += kTrees) {  // the trees' bits are disjoint: their misses are independent
    if ((asked[bit >> 6] >> (bit & 63)) & 1) continue;
    std::size_t ones = 0;
    for (const TreeEntry& e : entries) ones += bit_of(e.descriptor, bit);
    const std::size_t imbalance = 2 * ones > n ? 2 * ones - n : n - 2 * ones;
    if (imbalance < best_imbalance) {
      best_imbalance = imbalance;
      best_bit = bit;
      best_ones = ones;
    }
  }
  const auto smaller = static_cast<double>(std::min(best_ones, n - best_ones));
  if (best_bit < 0 || smaller < kMinShare * static_cast<double>(n)) {
    tree.leaves[leaf_index].split_at *= 2;  // all alike: try again when there are twice as many
    return;
  }
  Leaf zero, one;
  zero.split_at = one.split_at = leaf_capacity_;
  zero.entries.reserve(n - best_ones);
  one.entries.reserve(best_ones);
  for (const TreeEntry& e : entries) (bit_of(e.descriptor, best_bit) ? one : zero).entries.push_back(e);
  zero.split_at = std::max(leaf_capacity_, zero.entries.size() + 1);
  one.split_at = std::max(leaf_capacity_, one.entries.size() + 1);
  tree.leaves[leaf_index] = std::move(zero);
  const auto first_child = static_cast<std::int32_t>(tree.nodes.size());
  tree.nodes.push_back({-1, static_cast<std::int32_t>(leaf_index)});
  tree.nodes.push_back({-1, static_cast<std::int32_t>(tree.leaves.size())});
  tree.leaves.push_back(std::move(one));
  tree.nodes[static_cast<std::size_t>(node)] = {best_bit, first_child};
}

void HammingTree::search(const Descriptor& query, int max_distance, std::vector<TreeMatch>& matches) const {
  matches.clear();
  for (const Tree& tree : trees_) search_tree(tree, query, max_distance, matches);
  std::sort(matches.begin(), matches.end(), [](const TreeMatch& a, const TreeMatch& b) {
    return std::tie(a.submap, a.distance, a.feature) < std::tie(b.submap, b.distance, b.feature);
  });
  matches.erase(std::unique(matches.begin(), matches.end(),
                            [](const TreeMatch& a, const TreeMatch& b) {
                              return a.submap == b.submap && a.feature == b.feature;
                            }),
                matches.end());
}

void HammingTree::search_tree(const Tree& tree, const Descriptor& query, int max_distance,
                              std::vector<TreeMatch>& matches) const {
  // Ways not taken, by the number of asked bits that the query would have to be wrong in. More than a few
  // wrong bits are never reached within the budget, so buckets do instead of a heap.
  constexpr int kBuckets = 4;
  thread_local std::array<std::vector<std::int32_t>, kBuckets> open;
  for (auto& bucket : open) bucket.clear();
  open[0].push_back(0);
  int budget = leaves_per_tree_;
  for (std::size_t wrong = 0; wrong < kBuckets && budget > 0; ++wrong) {
    for (std::size_t i = 0; i < open[wrong].size() && budget > 0; ++i) {
      std::int32_t node = open[wrong][i];
      while (tree.nodes[static_cast<std::size_t>(node)].bit >= 0) {
        const Node& n = tree.nodes[static_cast<std::size_t>(node)];
        const std::int32_t taken = bit_of(query, n.bit);
        if (wrong + 1 < kBuckets) open[wrong + 1].push_back(n.child + 1 - taken);
        node = n.child + taken;
      }
      const auto& entries =
          tree.leaves[static_cast<std::size_t>(tree.nodes[static_cast<std::size_t>(node)].child)].entries;
      scan_leaf(entries.data(), entries.size(), query, max_distance, matches);
      --budget;
    }
  }
}

std::size_t HammingTree::memory() const {
  std::size_t bytes = 0;
  for (const Tree& tree : trees_) {
    bytes += tree.nodes.capacity() * sizeof(Node) + tree.leaves.capacity() * sizeof(Leaf);
    for (const Leaf& leaf : tree.leaves) bytes += leaf.entries.capacity() * sizeof(TreeEntry);
  }
  return bytes;
}

}  // namespace hp2
