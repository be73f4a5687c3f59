"""A battery by power: energy in, energy out, and the voltage that a pilot would read."""

from __future__ import annotations

CELLS = 6
_CELL_FULL_V, _CELL_EMPTY_V = 4.15, 3.45
_RESISTANCE_OHM = 0.02
_NOMINAL_V = CELLS * (_CELL_FULL_V + _CELL_EMPTY_V) / 2.0


class Battery:
    """Charge of one pack; `draw` it, `swap` it.

    >>> battery = Battery(capacity_wh=1.0)
    >>> battery.draw(power_w=360.0, dt_s=5.0)
    >>> battery.remaining_percent
    50
    """

    __slots__ = ("capacity_wh", "consumed_mah", "energy_wh", "power_w")

    def __init__(self, capacity_wh: float) -> None:
        if not capacity_wh > 0.0:
            raise ValueError(f"a battery holds more than nothing: {capacity_wh} Wh")
        self.capacity_wh = capacity_wh
        self.energy_wh = capacity_wh
        self.power_w = 0.0
        self.consumed_mah = 0.0

    def draw(self, power_w: float, dt_s: float) -> None:
        """Take `power_w` for `dt_s`; an empty battery stays empty."""
        self.power_w = power_w
        if power_w <= 0.0:
            return
        hours = dt_s / 3600.0
        self.consumed_mah += 1000.0 * self.current_a * hours
        self.energy_wh = max(0.0, self.energy_wh - power_w * hours)

    def swap(self) -> None:
        """Put in a full pack; the autopilot's counters start again."""
        self.energy_wh = self.capacity_wh
        self.consumed_mah = 0.0
        self.power_w = 0.0

    @property
    def empty(self) -> bool:
        """No energy left: the motors stop."""
        return self.energy_wh <= 0.0

    @property
    def full(self) -> bool:
        """Never drawn from since the last swap."""
        return self.energy_wh >= self.capacity_wh

    @property
    def remaining_percent(self) -> int:
        """0 to 100, cut as an autopilot does."""
        return int(100.0 * self.energy_wh / self.capacity_wh + 1e-9)

    @property
    def consumed_wh(self) -> float:
        """Energy taken from this pack."""
        return self.capacity_wh - self.energy_wh

    @property
    def voltage_v(self) -> float:
        """Open-circuit voltage by charge, less what the load drops."""
        charge = self.energy_wh / self.capacity_wh
        rest = CELLS * (_CELL_EMPTY_V + (_CELL_FULL_V - _CELL_EMPTY_V) * charge)
        return rest - _RESISTANCE_OHM * self.power_w / rest

    @property
    def current_a(self) -> float:
        """Load current."""
        return self.power_w / self.voltage_v

    @property
    def capacity_mah(self) -> float:
        """Rated charge, at the middle voltage."""
        return 1000.0 * self.capacity_wh / _NOMINAL_V
