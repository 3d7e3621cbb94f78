# The Debian packages: cpack -G DEB in the build folder; scripts/package.sh does all of it.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME hp2-slam)
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "LiDAR SLAM with an adaptive hybrid ICP, over LCM")  # first line of each package
set(CPACK_PACKAGE_VENDOR "HP2-SLAM")
set(CPACK_PACKAGE_CONTACT "The HP2-SLAM authors <hp2-slam@example.org>")
set(CPACK_PACKAGE_HOMEPAGE_URL "https://example.org/hp2-slam")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS
  OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_GROUPING ONE_PER_GROUP)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_BUILD_SOURCE_DIRS ${CMAKE_SOURCE_DIR} ${CMAKE_BINARY_DIR})
if(CMAKE_CROSSCOMPILING)
  set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS_PRIVATE_DIRS "")
endif()

set(CPACK_COMPONENTS_ALL runtime dev)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_NAME hp2-slam)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_SECTION science)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_DEPENDS iproute2)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_RECOMMENDS "python3, liblcm-bin")
set(CPACK_COMPONENT_RUNTIME_DESCRIPTION  # one line: cpack 3.25 does not end with several
  "Scans of a LiDAR go in, a globally consistent trajectory and a map come out.")
set(CPACK_DEBIAN_RUNTIME_DEBUGINFO_PACKAGE ON)

set(CPACK_DEBIAN_DEV_PACKAGE_NAME hp2-slam-dev)
set(CPACK_DEBIAN_DEV_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEV_PACKAGE_DEPENDS
  "libeigen3-dev, libspdlog-dev, libyaml-cpp-dev, nlohmann-json3-dev, robin-map-dev, liblcm-dev")
set(CPACK_DEBIAN_DEV_PACKAGE_SHLIBDEPS OFF)
set(CPACK_COMPONENT_DEV_DESCRIPTION
  "Headers and static libraries of odometry and evaluation, and find_package(hp2).")

# changelog and copyright of each package, as Debian wants them
string(TIMESTAMP date "%a, %d %b %Y %H:%M:%S +0000" UTC)
set(folder ${CMAKE_CURRENT_BINARY_DIR}/debian)
file(CONFIGURE OUTPUT ${folder}/changelog CONTENT "hp2-slam (${PROJECT_VERSION}-1) bookworm; urgency=medium

  * See the project's CHANGELOG.md.

 -- ${CPACK_PACKAGE_CONTACT}  ${date}
")
find_program(GZIP gzip REQUIRED)
# compresses FILE into FOLDER for PACKAGE's documentation
function(hp2_documentation component package)
  set(doc ${CMAKE_INSTALL_DATADIR}/doc/${package})
  install(FILES ${folder}/changelog.Debian.gz DESTINATION ${doc} COMPONENT ${component})
  install(FILES ${CMAKE_CURRENT_SOURCE_DIR}/debian/copyright DESTINATION ${doc} COMPONENT ${component})
endfunction()
execute_process(COMMAND ${GZIP} -9nc ${folder}/changelog OUTPUT_FILE ${folder}/changelog.Debian.gz COMMAND_ERROR_IS_FATAL ANY)
hp2_documentation(runtime hp2-slam)
hp2_documentation(dev hp2-slam-dev)
if(HP2_WITH_PYTHON)
  list(APPEND CPACK_COMPONENTS_ALL python)
  set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME python3-hp2slam)
  set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
  set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS "python3 (>= 3.11), python3 (<< 3.12), python3-numpy")
  set(CPACK_COMPONENT_PYTHON_DESCRIPTION
    "For Python: stored sessions, odometry on arrays, evaluation, LCM messages.")
  hp2_documentation(python python3-hp2slam)
endif()
include(CPack)
