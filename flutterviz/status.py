"""Owns the verdict on a session's motion, in words: stable, growing, limit cycle, controlled, passive."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from flutterviz.session import Session

Tone = Literal["calm", "good", "warn", "bad"]

PERIODS = 3
SETTLED = 0.98  # of its largest |w|, that a panel at rest keeps to; one in motion passes near zero
SWINGS = 12  # periods by which flutter is judged to be irregular
UNEVEN = 0.1  # mean change of the peak from one to the next, of the mean peak; a limit cycle's is below 0.01
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
    pressure = plant.stream.dynamic_pressure
    driven = session.engaged and rig.loop.law.asks and rig.refusal is None
    growth = rig.loop.growth.real if driven else plant.growth.real
    word, detail, icon, tone = _verdict(session, driven, critical)
    if session.paused and not session.error:
        word = f"Paused · {word}"
    return Status(word, detail, icon, tone, pressure / critical if critical else None, growth)


def _verdict(session: Session, driven: bool, critical: float | None) -> tuple[str, str, str, Tone]:
    rig, plant = session.rig, session.rig.plant
    pressure = plant.stream.dynamic_pressure
    if session.error:
        return "Stopped", session.error, "✖", "bad"
    if driven and rig.shortfall and not plant.flutters:
        return "Controller does harm", f"without it the panel would be stable: {rig.shortfall}", "!", "bad"
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
    if session.engaged and not driven and not rig.refusal:
        off = rig.design.control.kind == "off"
        return "Controller off", "choose LQR, LQG or rate" if off else "its patches move nothing", "!", "warn"
    if session.engaged and rig.refusal:
        return "Controller impossible", rig.refusal, "!", "bad"
    if driven:
        if rig.shortfall:
            word = "Controlled in part" if session.damping_time is None else "Quiet, but unstable"
            return word, rig.shortfall, "!", "warn"
        if session.damping_time is not None:
            return "Controlled, quiet", f"damped {session.damping_time:.3f} s after {session.disturbed_by}", "✔", "good"
        if session.amplitude < session.design.run.settled:
            return "Controlled, quiet", "there is nothing left to damp", "✔", "good"
        volts = session.history.since(session.time - session.period).volts
        saturated = bool(np.any(np.abs(volts) >= 0.999 * rig.loop.law.limit))
        if session.outlasts and rig.loop.law.hears_noise and not saturated:
            return "Held, but not quiet", "sensor noise keeps the patches, and so the panel, moving", "!", "warn"
        if session.outlasts:
            limit = "the drive is at its limit" if saturated else "small motions would die out, this one does not"
            return "Not suppressed", f"{limit}; patch more elements, or lower λ", "!", "bad"
        return "Controlled", "at the voltage limit" if saturated else "damping the flutter", "▼", "calm"
    if _at_rest(session):
        return "Buckled", "at rest in a deflection: preload or heat has pushed the panel out of its plane", "◠", "warn"
    if _uneven(session):
        return "Irregular flutter", "no swing is like the last: chaos, or several frequencies at once", "≋", "warn"
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


def _at_rest(session: Session) -> bool:
    """Whether the panel has stood still, deflected, for the last two periods."""
    largest = session.history.since(session.time - 2 * session.period).largest
    return len(largest) > 8 and largest.min() > max(SETTLED * largest.max(), session.design.run.settled)


def _uneven(session: Session) -> bool:
    """Whether the largest |w| goes up and down from period to period, more than flutter that grows or settles does."""
    rows = session.history.since(session.time - SWINGS * session.period)
    known = rows.times[-1] - rows.times[0] if len(rows) else 0.0
    if known < (SWINGS - 1) * session.period or session.amplitude < 0.02:
        return False
    peaks = np.array([part.max() for part in np.array_split(rows.largest, SWINGS)])
    changes = np.diff(peaks)
    turns = int((changes[:-1] * changes[1:] < 0).sum())
    return turns >= SWINGS // 3 and float(np.abs(changes).mean()) > UNEVEN * float(peaks.mean())


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
