# find_package(hp2): the odometry and the evaluation as libraries, and the message types. Targets:
#   hp2::frontend      scans in, poses and submaps out; knows nothing of LCM
#   hp2::registration  ICP to a local map, registration of two clouds
#   hp2::evaluation    ATE, RPE, the KITTI metric
#   hp2::common        scans, poses, configuration
#   hp2::lcmtypes      headers hp2/NAME.hpp of the LCM types (needs liblcm-dev)
include(CMakeFindDependencyMacro)
find_dependency(Threads)
find_dependency(Eigen3)
find_dependency(spdlog)
find_dependency(yaml-cpp)
find_dependency(nlohmann_json)
include(${CMAKE_CURRENT_LIST_DIR}/hp2Targets.cmake)
