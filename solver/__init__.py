"""Panel flutter and its suppression by piezoceramic patches: finite elements, modes, control and runs in time."""

from solver.design import Control, Design, Flow, MeshSize, Panel, Patches, Reduction, Run
from solver.errors import ControlError, DesignError
from solver.files import design_from_json, design_to_json, load_design, preset_names, save_design
from solver.flutter import critical_pressure, critical_pressure_full
from solver.limitcycle import LimitCycle, limit_cycle
from solver.mesh import Mesh
from solver.modes import ModalModel
from solver.plant import Plant
from solver.regulator import Regulator, nfcg
from solver.simulate import Loop, first_mode_at_rest, seed_protocol
from solver.summary import FlutterFacts, RunFacts, flutter_facts, run_facts
from solver.trace import Trace

__all__ = [
    "Control",
    "ControlError",
    "Design",
    "DesignError",
    "Flow",
    "FlutterFacts",
    "LimitCycle",
    "Loop",
    "Mesh",
    "MeshSize",
    "ModalModel",
    "Panel",
    "Patches",
    "Plant",
    "Reduction",
    "Regulator",
    "Run",
    "RunFacts",
    "Trace",
    "critical_pressure",
    "critical_pressure_full",
    "design_from_json",
    "design_to_json",
    "first_mode_at_rest",
    "flutter_facts",
    "limit_cycle",
    "load_design",
    "nfcg",
    "preset_names",
    "run_facts",
    "save_design",
    "seed_protocol",
]
