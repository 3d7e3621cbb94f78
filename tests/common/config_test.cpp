#include "common/config.hpp"

#include <sys/stat.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/error.hpp"
#include "tests/temporary_folder.hpp"

namespace hp2 {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

class ConfigTest : public ::testing::Test {
 protected:
  ConfigTest() {
    ConfigSection s("frontend");
    s.add("voxel_size_m", voxel_size_m, "Edge of a voxel [m]", 0.01, 10.0);
    s.add("max_iterations", max_iterations, "Most iterations", 1, 1000);
    s.add("deskew", deskew, "Undo the motion in the sweep");
    s.add("mode", mode, "Residuals", {"hybrid", "point_to_point"});
    s.add("offsets_m", offsets_m, "Offsets [m]", -1.0, 1.0);
    config.add(std::move(s));
    config.ignore({"backend"});
  }
  void load(const std::string& text) {
    const test::TemporaryFolder folder;
    config.load(folder.write("config.yaml", text));
  }
  std::string error_of(const std::string& text) {
    try {
      load(text);
    } catch (const Error& e) {
      return e.what();
    }
    return "no error";
  }

  double voxel_size_m = 1.0;
  int max_iterations = 10;
  bool deskew = true;
  std::string mode = "hybrid";
  std::vector<double> offsets_m;
  Config config;
};

TEST_F(ConfigTest, ReadsListsOfNumbers) {
  load("frontend:\n  offsets_m: [0.5, -0.25]\n");
  EXPECT_EQ(offsets_m, (std::vector<double>{0.5, -0.25}));
  EXPECT_THAT(config.print(), HasSubstr("offsets_m: [0.5, -0.25]"));
  config.set("frontend.offsets_m=[1, 0]");
  EXPECT_EQ(offsets_m, (std::vector<double>{1.0, 0.0}));
  config.set("frontend.offsets_m=[]");
  EXPECT_TRUE(offsets_m.empty());
  EXPECT_THAT(error_of("frontend:\n  offsets_m: [0.5, 3]\n"), AllOf(HasSubstr("3"), HasSubstr("[-1, 1]")));
  EXPECT_THAT(error_of("frontend:\n  offsets_m: [0.5, x]\n"), HasSubstr("a list of numbers"));
  EXPECT_THROW(config.set("frontend.offsets_m=[1"), Error);
}

TEST_F(ConfigTest, AnAssignmentIsALineOfAFile) {
  load("frontend:\n  voxel_size_m: 0.5\n");
  config.set("frontend.voxel_size_m=0.25");
  config.set("frontend.deskew=false");
  config.set("frontend.mode=point_to_point");
  config.set("backend.whatever=1");  // another program's
  EXPECT_EQ(voxel_size_m, 0.25);
  EXPECT_FALSE(deskew);
  EXPECT_EQ(mode, "point_to_point");
  const auto message = [&](const std::string& assignment) -> std::string {
    try {
      config.set(assignment);
    } catch (const Error& e) {
      return e.what();
    }
    return "no error";
  };
  EXPECT_THAT(message("frontend.voxel_size=1"), HasSubstr("Did you mean \"frontend.voxel_size_m\"?"));
  EXPECT_THAT(message("frontend.voxel_size_m=100"), HasSubstr("out of range"));
  EXPECT_THAT(message("frontend.max_iterations=many"), HasSubstr("frontend.max_iterations=many"));
  for (const char* wrong : {"", "frontend", "frontend.=1", "voxel_size_m=1", ".a=1", "a=1.5"})
    EXPECT_THAT(message(wrong), HasSubstr("section.key=value")) << wrong;
  EXPECT_EQ(voxel_size_m, 0.25);
}

TEST_F(ConfigTest, ReadsValuesAndKeepsDefaults) {
  load("frontend:\n  voxel_size_m: 0.5\n  mode: point_to_point\nbackend:\n  whatever: 1\n");
  EXPECT_EQ(voxel_size_m, 0.5);
  EXPECT_EQ(mode, "point_to_point");
  EXPECT_EQ(max_iterations, 10);
}

TEST_F(ConfigTest, NamesTheNearestKeyOfATypo) {
  EXPECT_THAT(error_of("frontend:\n  voxel_sise_m: 0.5\n"),
              AllOf(HasSubstr("voxel_sise_m"), HasSubstr("line 2"), HasSubstr("\"frontend.voxel_size_m\"")));
  EXPECT_THAT(error_of("frontent:\n  deskew: true\n"), HasSubstr("\"frontend\""));
  EXPECT_THAT(error_of("frontend:\n  mode: hybird\n"), HasSubstr("\"hybrid\""));
}

TEST_F(ConfigTest, RefusesWrongTypesRangesAndFiles) {
  EXPECT_THAT(error_of("frontend:\n  max_iterations: many\n"), HasSubstr("whole number"));
  EXPECT_THAT(error_of("frontend:\n  max_iterations: 0\n"), HasSubstr("[1, 1000]"));
  EXPECT_THAT(error_of("frontend:\n  voxel_size_m: .nan\n"), HasSubstr("out of range"));
  EXPECT_THAT(error_of("frontend: [1, 2"), HasSubstr("not valid YAML"));
  EXPECT_THAT(error_of("- 1\n- 2\n"), HasSubstr("not a map"));
  EXPECT_THROW(config.load("/does/not/exist.yaml"), Error);
}

TEST_F(ConfigTest, PrintsAFileThatItReadsBack) {
  voxel_size_m = 0.35;
  const std::string text = config.print();
  voxel_size_m = 1.0;
  load(text);
  EXPECT_EQ(voxel_size_m, 0.35);
}

TEST_F(ConfigTest, RefusesAKeyOrASectionThatIsThereTwice) {
  EXPECT_THAT(error_of("frontend:\n  deskew: true\n  voxel_size_m: 0.5\n  deskew: false\n"),
              AllOf(HasSubstr("frontend.deskew"), HasSubstr("twice"), HasSubstr("line 4")));
  EXPECT_THAT(error_of("frontend:\n  deskew: true\nbackend:\n  a: 1\nfrontend:\n  deskew: false\n"),
              AllOf(HasSubstr("\"frontend\""), HasSubstr("twice"), HasSubstr("line 5")));
}

TEST_F(ConfigTest, RefusesASecondDocument) {
  EXPECT_THAT(error_of("frontend:\n  deskew: true\n---\nfrontend:\n  deskew: false\n"),
              HasSubstr("2 YAML documents"));
  EXPECT_EQ(error_of("---\nfrontend:\n  deskew: true\n"), "no error");
}

TEST_F(ConfigTest, RefusesFoldersAndPipesWithoutWaiting) {
  const test::TemporaryFolder folder;
  const auto error = [&](const std::string& path) -> std::string {
    try {
      config.load(path);
    } catch (const Error& e) {
      return e.what();
    }
    return "no error";
  };
  EXPECT_THAT(error(folder.path()), HasSubstr("is a folder"));
  const std::string pipe = folder.path() + "/pipe";
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  EXPECT_THAT(error(pipe), HasSubstr("a pipe or a device"));
}

TEST_F(ConfigTest, NamesTheKeyThatIsMeantOrNone) {
  EXPECT_THAT(error_of("frontend:\n  voxel: 1\n"), HasSubstr("Did you mean \"frontend.voxel_size_m\"?"));
  EXPECT_THAT(error_of("frontend:\n  MaxIterations: 1\n"),
              HasSubstr("Did you mean \"frontend.max_iterations\"?"));
  EXPECT_THAT(error_of("frontend:\n  iterations: 1\n"),
              HasSubstr("Did you mean \"frontend.max_iterations\"?"));
  EXPECT_THAT(error_of("frontend:\n  loop_distance: 1\n"),
              AllOf(HasSubstr("Known are: voxel_size_m"), ::testing::Not(HasSubstr("Did you mean"))));
}

TEST_F(ConfigTest, NamesTheSectionThatAKeyBelongsTo) {
  double overlap = 0.4;
  ConfigSection closures("closures");
  closures.add("min_overlap", overlap, "Least overlap");
  config.add(std::move(closures));
  EXPECT_THAT(error_of("frontend:\n  min_overlap: 1\n"), HasSubstr("closures.min_overlap"));
}

}  // namespace
}  // namespace hp2
