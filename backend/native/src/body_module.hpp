#pragma once
#include <nanobind/nanobind.h>

namespace stridelab {

void bind_body(nanobind::module_& module);

}  // namespace stridelab
