#pragma once
#include <nanobind/nanobind.h>

namespace stridelab {

void bind_body_rows(nanobind::module_& module);

}  // namespace stridelab
