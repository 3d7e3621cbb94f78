// hp2_write_dataset: any drive with ground truth as a drive in a public data set's layout.
#include <cstdio>

#include <CLI/CLI.hpp>

#include "common/program.hpp"
#include "tests/datasets/dataset_writers.hpp"

int main(int argc, char** argv) {
  CLI::App app("Writes a drive with ground truth in the layout of a public data set, for tests.",
               "hp2_write_dataset");
  std::string data, format, folder;
  hp2::SourceOptions options;
  app.add_option("data", data, "Drive: a folder, or synthetic:SCENE[:SEED]")->required();
  app.add_option("format", format, "Layout")->required()->check(CLI::IsMember(hp2::test::dataset_formats()));
  app.add_option("folder", folder, "The drive's folder; for kitti it ends in sequences/NN")->required();
  app.add_option("--first", options.first, "Skip so many scans");
  app.add_option("--count", options.count, "Take at most so many scans (0: all)");
  CLI11_PARSE(app, argc, argv);
  return hp2::run_program("hp2_write_dataset", [&] {
    const auto drive = hp2::open_source(data, options);
    hp2::test::write_dataset(*drive, format, folder);
    std::printf("%s: %zu scans of %s as %s\n", folder.c_str(), drive->size(), data.c_str(), format.c_str());
    return 0;
  });
}
