// The binding: Python sees flat arrays go in and come out; the solver knows nothing of Python.
#include <nanobind/nanobind.h>

NB_MODULE(_native, module) {
  module.attr("__version__") = "0.1.0";
}
