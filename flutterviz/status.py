"""Owns the verdict on a session's motion, in words: stable, growing, limit cycle, controlled, passive."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from flutterviz.session import Session

Tone = Literal["calm", "good", "warn", "bad"]

PERIODS = 3
STEADY = 0.02  # change of the amplitude a period that counts as none, as of a limit cycle


@dataclass(frozen=True)
class Status:
    """What the panel is doing."""

    word: str
    """The state, in a few words."""
    detail: str
    """One sentence more."""
    icon: str
    """A sign that tells the states apart without colour."""
    tone: Tone
    """How the state is to be taken."""
    pressure_ratio: float | None
    """λ/λ_cr with the patches on [-]; None where there is no flutter."""
    growth: float
    """Growth rate of the flat panel as it is driven now [1/s]."""


def status_of(session: Session) -> Status:
    """Judge a session by its eigenvalues and its recent past."""
    rig, plant = session.rig, session.rig.plant
    critical = plant.critical[0] if plant.critical else None
    pressure = rig.design.flow.dynamic_pressure
    driven = session.engaged and bool(plant.channels) and rig.refusal is None
    growth = rig.loop.regulator.growth.real if driven else plant.growth.real
    word, detail, icon, tone = _verdict(session, driven, critical)
    if session.paused and not session.error:
        word = f"Paused · {word}"
    return Status(word, detail, icon, tone, pressure / critical if critical else None, growth)


def _verdict(session: Session, driven: bool, critical: float | None) -> tuple[str, str, str, Tone]:
    rig, plant = session.rig, session.rig.plant
    pressure = rig.design.flow.dynamic_pressure
    if session.error:
        return "Stopped", session.error, "✖", "bad"
    if plant.passive and rig.bare_critical is not None and pressure >= rig.bare_critical:
        raised = f"{critical:.0f}" if critical else "none"
        detail = f"the patches end the flutter by stiffness and mass alone: λ_cr {rig.bare_critical:.0f} → {raised}"
        return "Passive", detail, "◆", "good"
    if not plant.flutters:
        dies = plant.growth.real < -1e-9 * plant.model.omega[0]
        detail = "every motion dies out" if dies else "nothing damps the motion: it neither grows nor dies out"
        return "Stable", f"below the critical dynamic pressure: {detail}", "●", "good"
    if session.engaged and not plant.channels:
        return "Controller has no patches", "click elements of the panel to patch them", "!", "warn"
    if session.engaged and rig.refusal:
        return "Controller impossible", rig.refusal, "!", "bad"
    if driven:
        if rig.loop.regulator.growth.real > 0:
            word = "Controlled in part" if session.damping_time is None else "Quiet, but unstable"
            return word, "a growing mode is out of reach; patch one side alone", "!", "warn"
        if session.damping_time is not None:
            return "Controlled, quiet", f"damped {session.damping_time:.3f} s after {session.disturbed_by}", "✔", "good"
        if session.amplitude < session.design.run.settled:
            return "Controlled, quiet", "there is nothing left to damp", "✔", "good"
        volts = session.history.since(session.time - session.period).volts
        saturated = bool(np.any(np.abs(volts) >= 0.999 * rig.loop.regulator.limit))
        return "Controlled", "at the voltage limit" if saturated else "damping the flutter", "▼", "calm"
    trend = recent_growth(session)
    if trend is None:
        return "Fluttering", "just begun: too early to tell growth from a limit cycle", "▲", "warn"
    if abs(trend) * session.period <= STEADY:
        if session.amplitude < 0.02:
            return "Flutter growing", "from small beginnings", "▲", "bad"
        return "Limit cycle", "flutter held by the panel's own membrane stretching", "⟳", "warn"
    if trend > 0:
        return "Flutter growing", f"amplitude growing at {trend:.0f} /s", "▲", "bad"
    return "Settling to the limit cycle", f"amplitude changing at {trend:.0f} /s", "▽", "warn"


def recent_growth(session: Session) -> float | None:
    """Growth rate of the motion [1/s], by the peaks of its last and last but one few periods; None if unknown."""
    times = session.history.times
    known = (session.time - times[0]) / (2 * session.period) if len(times) else 0.0
    # several periods, or the beat of two modes is taken for growth and decay in turn; fewer after a fresh start
    span = min(PERIODS, np.floor(known)) * session.period
    rows = session.history.since(session.time - 2 * span)
    if span == 0 or len(rows) < 8:
        return None
    late = rows.times > session.time - span
    first, second = rows.largest[~late].max(initial=0.0), rows.largest[late].max(initial=0.0)
    if min(first, second) <= 0:
        return None
    return float(np.log(second / first) / span)
