// Folders and files for the viewer's tests.
#pragma once
#include "tests/temporary_folder.hpp"

namespace hp2::testing {

using test::content;
using test::TemporaryFolder;

}  // namespace hp2::testing
