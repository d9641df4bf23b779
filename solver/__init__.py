"""Panel flutter and its suppression by piezoceramic patches: finite elements, modes, control and runs in time."""

from solver.aerodynamics import Stream
from solver.authority import AuthorityMap, authority, nfcg
from solver.branches import Event, Step, follow
from solver.buckling import buckling_factor
from solver.compensator import Compensator, Gain
from solver.controlfacts import ControlFacts, control_facts
from solver.controllers import Controller, law_of
from solver.cycles import limit_cycles
from solver.design import Control, Design, Flow, Load, MeshSize, Panel, Patches, Ply, Reduction, Run
from solver.equilibrium import StaticState, critical_pressure_deflected, static_states
from solver.errors import ControlError, DesignError
from solver.estimate import ErrorEstimate, Estimate, estimate_error
from solver.files import design_from_json, design_to_json, load_design, preset_names, save_design
from solver.flutter import critical_pressure, critical_pressure_full
from solver.fullorder import FullModel
from solver.fullrun import FullTrace, full_limit_cycle, full_run, full_seed_protocol
from solver.holding import Hold, HoldRow, hold_over, stabilises_up_to, suppresses_up_to
from solver.law import Law
from solver.limitcycle import LimitCycle, limit_cycle
from solver.materials import Material, material, material_names
from solver.mesh import Mesh
from solver.modes import ModalModel
from solver.motion import Motion, motion_of
from solver.observer import Lqg
from solver.outcome import Outcome, outcome_of
from solver.passive import patch_growth
from solver.plant import Plant
from solver.ranking import Ranking
from solver.ratefeedback import RateFeedback
from solver.regulator import Lqr
from solver.robust import RobustDamping, robust_damping
from solver.rootlocus import RootLocus, gain_locus, root_locus
from solver.score import Score
from solver.search import Progress, search
from solver.shooting import Orbit, find_orbit
from solver.simulate import Loop, Memory, first_mode_at_rest, seed_protocol
from solver.summary import FlutterFacts, RunFacts, flutter_facts, run_facts
from solver.sweep import SweepRow, set_field, sweep
from solver.task import Task
from solver.trace import Trace
from solver.workers import local_workers

__all__ = [
    "AuthorityMap",
    "Compensator",
    "Control",
    "ControlError",
    "ControlFacts",
    "Controller",
    "Design",
    "DesignError",
    "ErrorEstimate",
    "Estimate",
    "Event",
    "Flow",
    "FlutterFacts",
    "FullModel",
    "FullTrace",
    "Gain",
    "Hold",
    "HoldRow",
    "Law",
    "LimitCycle",
    "Load",
    "Loop",
    "Lqg",
    "Lqr",
    "Material",
    "Memory",
    "Mesh",
    "MeshSize",
    "ModalModel",
    "Motion",
    "Orbit",
    "Outcome",
    "Panel",
    "Patches",
    "Plant",
    "Ply",
    "Progress",
    "Ranking",
    "RateFeedback",
    "Reduction",
    "RobustDamping",
    "RootLocus",
    "Run",
    "RunFacts",
    "Score",
    "StaticState",
    "Step",
    "Stream",
    "SweepRow",
    "Task",
    "Trace",
    "authority",
    "buckling_factor",
    "control_facts",
    "critical_pressure",
    "critical_pressure_deflected",
    "critical_pressure_full",
    "design_from_json",
    "design_to_json",
    "estimate_error",
    "find_orbit",
    "first_mode_at_rest",
    "flutter_facts",
    "follow",
    "full_limit_cycle",
    "full_run",
    "full_seed_protocol",
    "gain_locus",
    "hold_over",
    "law_of",
    "limit_cycle",
    "limit_cycles",
    "load_design",
    "local_workers",
    "material",
    "material_names",
    "motion_of",
    "nfcg",
    "outcome_of",
    "patch_growth",
    "preset_names",
    "robust_damping",
    "root_locus",
    "run_facts",
    "save_design",
    "search",
    "seed_protocol",
    "set_field",
    "stabilises_up_to",
    "static_states",
    "suppresses_up_to",
    "sweep",
]
