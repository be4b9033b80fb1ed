"""Results of slow functions outside of the reproduction, by their arguments: its tests and its mutants share them.

A function that is called with the same arguments as before returns a copy of the stored result. Calls whose arguments
cannot be pickled, or change during the call (random generators), are made. In a process with tests of other folders,
only those of the reproduction share results (``sharing``).
"""

import functools
import hashlib
import io
import pickle
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from stridelab.reachability.kinematics.ik_ground_truth import StanceTruth
from stridelab.robots.loader import load_robot
from stridelab.simulation.robot.gait_plan import WALKS
from stridelab.simulation.robot.runner import RUNNING, simulate_run
from stridelab.simulation.robot.walker import simulate_walk

BACKEND: Final = Path("backend/stridelab")
UNPICKLABLE: Final = (pickle.PicklingError, TypeError, AttributeError, ValueError, RuntimeError)
MIN_SECONDS: Final = 0.005
"""Results that take less are not stored."""
NAMES: Final[Mapping[str, tuple[str, ...]]] = {
    "stridelab.centroidal.solver": ("solve",),
    "stridelab.contacts.wrench_cones.thesis_lorentz_cone": ("outer_cone",),
    "stridelab.contacts.wrench_cones.wrench_cone": (
        "LinearCone.from_contacts", "LinearCone.largest_lorentz", "LinearCone.volume_ratio",
    ),
    "stridelab.estimation.complementary.filter": ("ComplementaryFilter.estimate",),
    "stridelab.estimation.evaluation.comparison": ("compare",),
    "stridelab.estimation.evaluation.truth_errors": ("truth_error",),
    "stridelab.estimation.kalman.filter": ("KalmanFilter.estimate", "RtsSmoother.estimate"),
    "stridelab.estimation.latency": ("estimate_latency",),
    "stridelab.estimation.smoother": ("Smoother.estimate",),
    "stridelab.measures.walk_motion": ("walk_motion",),
    "stridelab.reachability.kinematics.ik_ground_truth": ("StanceTruth.sample_com", "StanceTruth.search_feasible"),
    "stridelab.reachability.learning.fit": ("expectation_maximisation",),
    "stridelab.reachability.learning.kde": ("KernelDensity.log_density", "held_out_bandwidth_m"),
    "stridelab.reachability.proxy.contact_set_proxy": ("ContactSet.mode_m", "ContactSet.volumes_m3"),
    "stridelab.reachability.proxy.projections": ("project_kernels", "project_mixture"),
    "stridelab.simulation.human.walker": ("HumanWalker.walk",),
    "stridelab.simulation.human_recording": ("record",),
    "stridelab.walking.path_fit": ("fit_path",),
    "stridelab.walking.population.mixed_model": ("fit_mixed_model",),
    "stridelab.walking.population.population": ("study",),
    "stridelab.walking.step_fit": ("fit_step", "fit_steps"),
}  # fmt: skip
"""Slow functions and ``Class.method`` that the reproduction calls, by the module that it imports them from."""
_stored: dict[str, bytes] = {}
_is_on = {"sharing": True, "installed": False}


def share_in_tests() -> None:
    """Calls of ``NAMES`` are looked up inside of ``sharing``; to be called before the reproduction is imported."""
    if not _is_on["installed"]:
        store_results()
        _is_on["sharing"] = False


@contextmanager
def sharing() -> Iterator[None]:
    """Share results until the end of the block."""
    before = _is_on["sharing"]
    _is_on["sharing"] = True
    yield
    _is_on["sharing"] = before


def store_results() -> None:
    """From now on, calls of ``NAMES`` are looked up, and their results stored in this process and its forks."""
    _is_on["installed"] = True
    for module_name, names in NAMES.items():
        module = import_module(module_name)
        for name in names:
            of_class, _, attribute = name.rpartition(".")
            owner = getattr(module, of_class) if of_class else module
            memoised = _memoised(f"{module_name}.{name}", getattr(owner, attribute))
            is_static = isinstance(vars(owner).get(attribute), staticmethod)
            setattr(owner, attribute, staticmethod(memoised) if is_static else memoised)


def warm_caches() -> None:
    """Simulate the walks and load the robots that most items use, whose functions have caches."""
    for robot in ("talos", "hrp2"):
        load_robot(robot)
    for gait in WALKS.values():
        simulate_walk(gait, 0)
    simulate_run(RUNNING, 0)


def write_results(path: Path) -> None:
    """Write what this process has stored, and which modules of other projects it has imported."""
    modules = [name for name, module in sys.modules.items() if "site-packages" in str(getattr(module, "__file__", ""))]
    path.write_bytes(pickle.dumps((digest_of_library(), _stored, modules)))


def read_results(path: Path) -> None:
    """Read what another process has stored with the same library, and import the modules that it has imported."""
    digest, stored, modules = pickle.loads(path.read_bytes())
    if digest == digest_of_library():
        _stored.update(stored)
        for name in modules:
            with suppress(ImportError):
                import_module(name)


def digest_of_library() -> str:
    """Digest of the code and data that mutants leave as they are."""
    files = [*BACKEND.rglob("*.py"), *BACKEND.rglob("*.npz"), *BACKEND.rglob("*.json")]
    texts = (path.read_bytes() for path in sorted(files) if "reproduction" not in path.parts)
    return hashlib.sha256(b"".join(texts)).hexdigest()


def _memoised(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(function)
    def looked_up(*arguments: Any, **named: Any) -> Any:
        key = _key_of(name, arguments, named) if _is_on["sharing"] else None
        if key is None:
            return function(*arguments, **named)
        if key in _stored:
            return pickle.loads(_stored[key])
        start_s = time.process_time()
        result = function(*arguments, **named)
        if time.process_time() - start_s > MIN_SECONDS and key == _key_of(name, arguments, named):
            with suppress(*UNPICKLABLE):
                _stored[key] = pickle.dumps(result)
        return result

    return looked_up


def _key_of(name: str, arguments: tuple[Any, ...], named: Mapping[str, Any]) -> str | None:
    content = io.BytesIO()
    try:
        _ArgumentPickler(content).dump((arguments, sorted(named.items())))
    except UNPICKLABLE:
        return None
    return name + hashlib.sha256(content.getvalue()).hexdigest()


class _ArgumentPickler(pickle.Pickler):
    """Leaves out what a dataclass has cached, and which parts of the arguments are the same object."""

    def __init__(self, file: io.BytesIO) -> None:
        super().__init__(file)
        self.fast = True

    def reducer_override(self, thing: object) -> Any:
        """Type and fields of a dataclass; what a ground truth is made from; all else as usual."""
        module = str(getattr(thing, "__module__", None) or type(thing).__module__)
        if module.startswith("stridelab.reproduction"):
            raise pickle.PicklingError("a mutant may change what it does")
        if isinstance(thing, StanceTruth):
            return StanceTruth, (thing.robot.name, thing.within)
        if is_dataclass(thing) and not isinstance(thing, type):
            return type(thing), tuple(getattr(thing, field.name) for field in fields(thing))
        return NotImplemented
