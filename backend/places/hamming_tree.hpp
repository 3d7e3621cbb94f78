// Binary search trees over the bits of 256-bit descriptors: incremental insert and approximate search by
// Hamming distance, without ever rebuilding.
#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "backend/places/features.hpp"

namespace hp2 {

/// A stored descriptor with its submap and feature.
struct TreeEntry {
  Descriptor descriptor;
  std::int32_t submap = 0;
  std::int32_t feature = 0;  ///< Index into the submap's features.
};

/// A stored descriptor near a query.
struct TreeMatch {
  std::int32_t submap = 0;
  std::int32_t feature = 0;
  std::int32_t distance = 0;  ///< [bits]
};

/// Several trees over disjoint sets of bits. A node tests one bit; a full leaf is split on the bit that
/// divides it most evenly. One flipped bit leads to a wrong leaf. So a query visits several leaves of every
/// tree, in order of the number of tested bits that differ, up to a budget. A match that one tree misses,
/// another finds.
class HammingTree {
 public:
  static constexpr int kTrees = 3;

  /// @param leaf_capacity   entries of a leaf before it is split
  /// @param leaves_per_tree leaves that a query visits in each tree
  explicit HammingTree(int leaf_capacity = 48, int leaves_per_tree = 16);

  void insert(const TreeEntry& entry);
  /// All entries found within `max_distance` bits, sorted by submap, then distance, then feature; each once.
  void search(const Descriptor& query, int max_distance, std::vector<TreeMatch>& matches) const;

  std::size_t size() const { return size_; }
  /// Memory held [bytes].
  std::size_t memory() const;

 private:
  struct Node {
    std::int32_t bit = -1;    // asked for; -1: a leaf
    std::int32_t child = -1;  // index of the node for 0, that for 1 follows; in a leaf: index into leaves
  };
  struct Leaf {
    std::vector<TreeEntry> entries;
    std::size_t split_at = 0;  // size at which a split is tried
  };
  struct Tree {
    std::vector<Node> nodes;
    std::vector<Leaf> leaves;
  };
  void split(Tree& tree, int which, std::int32_t node, std::uint64_t asked[4]);
  void search_tree(const Tree& tree, const Descriptor& query, int max_distance,
                   std::vector<TreeMatch>& matches) const;

  std::array<Tree, kTrees> trees_;
  std::size_t leaf_capacity_;
  int leaves_per_tree_;
  std::size_t size_ = 0;
};

}  // namespace hp2
