"""All job kinds, by name. Importing this module imports no numeric package; runs are referenced by import path."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from stridelab.schemas.comparison import CompareEstimatorsInput, CompareEstimatorsSummary
from stridelab.schemas.cycloid import FitCycloidInput, FitCycloidSummary
from stridelab.schemas.jobs import (
    EstimateComInput,
    EstimateComSummary,
    SimulateRecordingInput,
    SimulateRecordingSummary,
)
from stridelab.schemas.plans import (
    LearnReachabilityInput,
    LearnReachabilitySummary,
    PlanContactsInput,
    PlanContactsSummary,
    PlanMotionInput,
    PlanMotionSummary,
)
from stridelab.schemas.population import (
    ReadBatchInput,
    ReadBatchSummary,
    StudyPopulationInput,
    StudyPopulationSummary,
)
from stridelab.schemas.receding import PlanRecedingInput, PlanRecedingSummary
from stridelab.schemas.reproduction import ReproduceInput, ReproduceSummary
from stridelab.schemas.sweeps import SweepInput, SweepSummary
from stridelab.service.kinds import batch_staging
from stridelab.service.kinds import staging as rows
from stridelab.service.kinds.base import JobKind
from stridelab.service.kinds.study_population import staging
from stridelab.service.processes.sandbox import Sandbox

FILMING: Final = Sandbox(programs=True, server=True)
"""Sandbox of plans, which use ffmpeg and the local server of viser's recorder."""

ESTIMATE_COM = JobKind(
    name="estimate-com",
    input_model=EstimateComInput,
    summary_model=EstimateComSummary,
    run="stridelab.service.kinds.estimate_com.run:run_in_child",
    stage=rows.stage_estimate_com,
    timeout_s=120.0,
)
COMPARE_ESTIMATORS = JobKind(
    name="compare-estimators",
    input_model=CompareEstimatorsInput,
    summary_model=CompareEstimatorsSummary,
    run="stridelab.service.kinds.compare_estimators:run_in_child",
    stage=rows.stage_compare_estimators,
    timeout_s=300.0,
)
FIT_CYCLOID = JobKind(
    name="fit-cycloid",
    input_model=FitCycloidInput,
    summary_model=FitCycloidSummary,
    run="stridelab.service.kinds.fit_cycloid.run:run_in_child",
    stage=rows.stage_fit_cycloid,
    timeout_s=120.0,
)
STUDY_POPULATION = JobKind(
    name="study-population",
    input_model=StudyPopulationInput,
    summary_model=StudyPopulationSummary,
    run="stridelab.service.kinds.study_population.run:run_in_child",
    stage=staging.stage_study_population,
    timeout_s=900.0,
    lane="long",
)
SIMULATE_RECORDING = JobKind(
    name="simulate-recording",
    input_model=SimulateRecordingInput,
    summary_model=SimulateRecordingSummary,
    run="stridelab.service.kinds.simulate_recording.run:run_in_child",
    stage=rows.stage_input,
    publish=rows.publish_simulated_recording,
    timeout_s=300.0,
    lane="long",
)

PLAN_CONTACTS = JobKind(
    name="plan-contacts",
    input_model=PlanContactsInput,
    summary_model=PlanContactsSummary,
    run="stridelab.service.kinds.plan_contacts:run_in_child",
    stage=rows.stage_input,
    timeout_s=120.0,
)
PLAN_MOTION = JobKind(
    name="plan-motion",
    input_model=PlanMotionInput,
    summary_model=PlanMotionSummary,
    run="stridelab.service.kinds.plan_motion.run:run_in_child",
    stage=rows.stage_plan_motion,
    timeout_s=600.0,
    memory_mb=4096,
    lane="long",
    sandbox=FILMING,
)
PLAN_RECEDING = JobKind(
    name="plan-receding",
    input_model=PlanRecedingInput,
    summary_model=PlanRecedingSummary,
    run="stridelab.service.kinds.plan_receding:run_in_child",
    stage=rows.stage_plan_receding,
    timeout_s=600.0,
    memory_mb=4096,
    lane="long",
    sandbox=FILMING,
)
SWEEP = JobKind(
    name="sweep",
    input_model=SweepInput,
    summary_model=SweepSummary,
    run="stridelab.service.kinds.sweep:run_in_child",
    stage=rows.stage_sweep,
    timeout_s=7200.0,
    memory_mb=8192,
    lane="long",
)
LEARN_REACHABILITY = JobKind(
    name="learn-reachability",
    input_model=LearnReachabilityInput,
    summary_model=LearnReachabilitySummary,
    run="stridelab.service.kinds.learn_reachability:run_in_child",
    stage=rows.stage_input,
    timeout_s=900.0,
    memory_mb=2048,
    lane="long",
    sandbox=Sandbox(programs=True),  # starts interpreters
)

REPRODUCE = JobKind(
    name="reproduce",
    input_model=ReproduceInput,
    summary_model=ReproduceSummary,
    run="stridelab.service.kinds.reproduce:run_in_child",
    stage=rows.stage_input,
    timeout_s=3600.0,
    memory_mb=4096,
    lane="long",
    sandbox=None,  # its input is a name of an experiment; starts fork servers
)

READ_BATCH = JobKind(
    name=batch_staging.READ_BATCH_KIND,
    input_model=ReadBatchInput,
    summary_model=ReadBatchSummary,
    run="stridelab.service.kinds.parse_batch:run_as_job",
    stage=batch_staging.stage_read_batch,
    publish=batch_staging.publish_read_batch,
    timeout_s=7200.0,
    memory_mb=4096,
    lane="long",
    offered=False,
    own_files=batch_staging.batch_prefix,
)
"""Parses a bulk upload that takes too long for a synchronous response."""

KINDS: Mapping[str, JobKind] = MappingProxyType(
    {
        kind.name: kind
        for kind in (
            ESTIMATE_COM,
            COMPARE_ESTIMATORS,
            FIT_CYCLOID,
            STUDY_POPULATION,
            SIMULATE_RECORDING,
            PLAN_CONTACTS,
            PLAN_MOTION,
            PLAN_RECEDING,
            SWEEP,
            LEARN_REACHABILITY,
            REPRODUCE,
            READ_BATCH,
        )
    }
)

PARSE_UPLOAD = "stridelab.service.kinds.parse_upload:run_in_child"
"""Import path of the parser of uploads, which is run by ``POST /recordings``, not by the queue."""

PARSE_BATCH = "stridelab.service.kinds.parse_batch:run_in_child"
"""Import path of the parser of bulk uploads, run by ``POST /recordings/batch`` and by the job ``read-batch``."""

_LIBRARIES: Final = ("numpy", "scipy.optimize", "scipy.spatial", "scipy.stats", "scipy.signal")
READING: Final = (*_LIBRARIES, "ezc3d", "pyarrow.parquet", PARSE_UPLOAD.partition(":")[0])
"""Modules preloaded by the fork server for children that parse uploads."""
COMPUTING: Final = (
    *_LIBRARIES,
    *("ezc3d", "pyarrow.parquet", "pinocchio", "casadi", "sqlalchemy.ext.asyncio", "trimesh", "sklearn.mixture"),
    *(kind.run.partition(":")[0] for kind in KINDS.values()),
    *("mujoco", "viser", "stridelab.wholebody.replay.replay"),
)
"""Modules preloaded by the fork server for children that run jobs; runs import the last three lazily."""
