"""Owns the passage of time: wall to simulated time by a slow-motion ladder, within what the machine can do."""

from __future__ import annotations

from dataclasses import dataclass

LADDER = (1 / 1000, 1 / 500, 1 / 250, 1 / 100, 1 / 50, 1 / 20, 1 / 10, 1 / 5, 1 / 2, 1.0)
"""Simulated seconds a second of wall time that can be chosen."""

CYCLE = 1.5  # s of wall time that one flutter cycle should take at first: slow enough to see the wave travel
FRAME = 1 / 30  # s; the page draws no more than this many pictures a second
BUDGET = 0.4  # of a frame's time that integration may take; beyond it the motion is slowed and tagged "capped"
LONGEST = 0.1  # s of wall time made up for after a stall; more would jump
SAMPLES_A_CYCLE = 8  # pictures a cycle below which the eye sees another motion than there is


def nearest_rate(period: float) -> float:
    """The ladder's rate at which a cycle of the given period [s] takes about 1.5 s of wall time."""
    return min(LADDER, key=lambda rate: abs(period / rate - CYCLE))


def next_rate(rate: float, steps: int) -> float:
    """The ladder's rate so many steps faster (or slower, if negative); the ladder's end where there are no more."""
    place = min(range(len(LADDER)), key=lambda k: abs(LADDER[k] - rate))
    return LADDER[min(max(place + steps, 0), len(LADDER) - 1)]


def rate_name(rate: float) -> str:
    """How a rate is called: 1/300, or real time."""
    return "real time" if rate == 1 else f"1/{round(1 / rate)}"


@dataclass
class Clock:
    """Turns wall time into simulated time."""

    rate: float
    """Asked rate: simulated seconds a second of wall time."""
    actual: float = 0.0
    """Rate reached lately."""
    capped: bool = False
    """Whether the machine could not keep the asked rate in the last frames."""
    _last: float | None = None
    _cost: float = 0.0  # s of computing a simulated second, smoothed

    def due(self, now: float) -> float:
        """Simulated time that has become due since the last call [s], `now` being wall time [s]."""
        wall = min(now - self._last, LONGEST) if self._last is not None else FRAME
        self._last = now
        asked = max(wall, 0.0) * self.rate
        affordable = BUDGET * FRAME / self._cost if self._cost > 0 else asked
        self.capped = asked > affordable
        given = min(asked, affordable)
        if wall > 0:
            self.actual += 0.2 * (given / wall - self.actual)
        return given

    def took(self, simulated: float, wall: float) -> None:
        """Report that so much simulated time [s] took so much wall time [s] to compute."""
        if simulated > 0:
            cost = wall / simulated
            self._cost += (0.2 if self._cost else 1.0) * (cost - self._cost)

    def aliased(self, period: float) -> bool:
        """Whether too few pictures fall on a cycle of this period [s] to follow the motion by eye."""
        return self.rate * FRAME * SAMPLES_A_CYCLE > period
