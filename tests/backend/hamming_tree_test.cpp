#include "backend/places/hamming_tree.hpp"

#include <algorithm>
#include <random>
#include <set>
#include <tuple>

#include <gtest/gtest.h>

namespace hp2 {
namespace {

Descriptor random_descriptor(std::mt19937_64& rng) { return {rng(), rng(), rng(), rng()}; }

Descriptor with_flipped_bits(Descriptor d, int n, std::mt19937_64& rng) {
  std::set<int> bits;
  while (static_cast<int>(bits.size()) < n) bits.insert(static_cast<int>(rng() % 256));
  for (const int b : bits) d[b >> 6] ^= std::uint64_t{1} << (b & 63);
  return d;
}

std::vector<TreeMatch> brute_force(const std::vector<TreeEntry>& all, const Descriptor& query,
                                   int max_distance) {
  std::vector<TreeMatch> matches;
  for (const auto& e : all) {
    const int d = hamming_distance(e.descriptor, query);
    if (d <= max_distance) matches.push_back({e.submap, e.feature, d});
  }
  return matches;
}

TEST(HammingTree, EqualsBruteForceWhileEveryLeafIsVisited) {
  std::mt19937_64 rng(1);
  HammingTree tree(16, 1 << 20);
  std::vector<TreeEntry> all;
  for (int i = 0; i < 100; ++i) {
    const TreeEntry e{random_descriptor(rng), i / 10, i % 10};
    all.push_back(e);
    tree.insert(e);
    // After every insert, also right before and after a split.
    auto expected = brute_force(all, e.descriptor, 120);
    std::sort(expected.begin(), expected.end(), [](const TreeMatch& a, const TreeMatch& b) {
      return std::tie(a.submap, a.distance, a.feature) < std::tie(b.submap, b.distance, b.feature);
    });
    std::vector<TreeMatch> found;
    tree.search(e.descriptor, 120, found);
    ASSERT_EQ(found.size(), expected.size()) << i;
    for (std::size_t k = 0; k < found.size(); ++k) {
      EXPECT_EQ(found[k].submap, expected[k].submap);
      EXPECT_EQ(found[k].feature, expected[k].feature);
      EXPECT_EQ(found[k].distance, expected[k].distance);
    }
  }
}

TEST(HammingTree, FindsMostNeighboursAndInventsNone) {
  std::mt19937_64 rng(2);
  HammingTree tree;
  std::vector<TreeEntry> all;
  const int n = 50000;
  for (int i = 0; i < n; ++i) {
    all.push_back({random_descriptor(rng), i / 500, i % 500});
    tree.insert(all.back());
  }
  EXPECT_EQ(tree.size(), static_cast<std::size_t>(n));
  int found = 0;
  std::vector<TreeMatch> matches;
  for (int q = 0; q < 1000; ++q) {
    const TreeEntry& truth = all[rng() % n];
    const Descriptor query = with_flipped_bits(truth.descriptor, 25, rng);
    tree.search(query, 50, matches);
    for (const auto& m : matches) {
      EXPECT_EQ(hamming_distance(all[m.submap * 500 + m.feature].descriptor, query), m.distance);
      found += m.submap == truth.submap && m.feature == truth.feature;
    }
  }
  EXPECT_GE(found, 850);
  EXPECT_LT(tree.memory(), static_cast<std::size_t>(n) * 40 * HammingTree::kTrees * 3);
}

TEST(HammingTree, HoldsManyEqualDescriptors) {
  std::mt19937_64 rng(3);
  const Descriptor d = random_descriptor(rng);
  HammingTree tree(8, 4);
  for (int i = 0; i < 5000; ++i) tree.insert({d, i, 0});
  std::vector<TreeMatch> matches;
  tree.search(d, 0, matches);
  EXPECT_EQ(matches.size(), 5000U);
  tree.search({~d[0], ~d[1], ~d[2], ~d[3]}, 50, matches);
  EXPECT_TRUE(matches.empty());
}

TEST(HammingTree, AnEmptyOneFindsNothing) {
  std::vector<TreeMatch> matches{{1, 2, 3}};
  HammingTree().search({1, 2, 3, 4}, 256, matches);
  EXPECT_TRUE(matches.empty());
}

}  // namespace
}  // namespace hp2
