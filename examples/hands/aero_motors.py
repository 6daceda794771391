"""The motors of an Aero Hand for `distal.hands.Hand`, through its own SDK: copy this file beside yours.

aero = aero_open_sdk.aero_hand.AeroHand(port)
hand = Hand(AeroMotors(aero, rig), rig)  # rig: from the table of aero_table.py
"""

from __future__ import annotations

from math import isfinite, nan


class AeroMotors:
    def __init__(self, hand, rig) -> None:
        self._hand = hand
        self._names = rig.drive_names
        self._last = dict.fromkeys(self._names, nan)
        self._sent = {}

    def read(self) -> dict[str, float]:
        """Return actuations [deg] and currents [mA] by column."""
        found = {}
        for name, position, current in zip(
            self._names, self._hand.get_actuations(), self._hand.get_actuator_currents()
        ):
            for column, value in ((f"{name}_position", position), (f"{name}_current", current)):
                if value is not None and isfinite(value):
                    found[column] = float(value)
            self._last[name] = found.get(f"{name}_position", self._last[name])
        return found

    def temperatures(self) -> dict[str, float]:
        """Return motor → temperature [°C]."""
        return {
            n: float(value)
            for n, value in zip(self._names, self._hand.get_actuator_temperatures())
            if value is not None
        }

    def write(self, goals: dict[str, float]) -> None:
        """Send actuations [deg]; a motor without a goal keeps the goal that it was sent last.

        The SDK sends the goals of all motors at once. A motor that was never sent a goal is sent the angle that it was read at
        last, once; while there is a motor with neither, nothing is sent. The reading is not sent anew each time, since a motor
        gives way under its load and would sink a little each time.
        """
        for name in self._names:
            goal = goals.get(name, nan)
            if isfinite(goal):
                self._sent[name] = float(goal)
            elif name not in self._sent and isfinite(self._last[name]):
                self._sent[name] = self._last[name]
        if len(self._sent) == len(self._names):
            self._hand.set_actuations([self._sent[name] for name in self._names])
