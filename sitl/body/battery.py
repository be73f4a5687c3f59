"""A battery by power: its energy, and the voltage that a pilot would read."""

from __future__ import annotations

CELLS = 6
_CELL_FULL_V, _CELL_EMPTY_V = 4.15, 3.45
_RESISTANCE_OHM = 0.02
_LOWEST_V = 5.0
_NOMINAL_V = CELLS * (_CELL_FULL_V + _CELL_EMPTY_V) / 2.0


class Battery:
    """Charge of one pack."""

    def __init__(self, capacity_wh: float) -> None:
        self.capacity_wh = capacity_wh
        self.energy_wh = capacity_wh
        self.power_w = 0.0
        self.consumed_mah = 0.0
        self._sag_v = 0.0
        self._set_v = 0.0
        self._dead_cells = 0
        self._unnoticed_wh = 0.0  # gone with a cell, but the autopilot only counts what flows

    def draw(self, power_w: float, dt_s: float) -> None:
        """Draw `power_w` for `dt_s`; an empty battery stays empty."""
        self.power_w = power_w
        if power_w <= 0.0:
            return
        hours = dt_s / 3600.0
        self.consumed_mah += 1000.0 * self.current_a * hours
        left_wh = self.energy_wh - power_w * hours
        self.energy_wh = left_wh if left_wh > 0.0 else 0.0

    def swap(self) -> None:
        """Put in a full pack; the autopilot's counters start again."""
        self.energy_wh = self.capacity_wh
        self.consumed_mah = 0.0
        self.power_w = 0.0
        self._dead_cells = 0
        self._unnoticed_wh = 0.0

    def fail_cell(self) -> None:
        """Short a cell: its voltage and its share of the energy are gone."""
        living = CELLS - self._dead_cells
        lost_wh = self.energy_wh / living
        self.energy_wh -= lost_wh
        self._unnoticed_wh += lost_wh
        self._dead_cells = min(CELLS - 1, self._dead_cells + 1)

    def disturb(self, *, sag_v: float, set_v: float) -> None:
        """Lower the voltage by `sag_v`; at rest it is `set_v`, if not 0, whatever the charge."""
        self._sag_v, self._set_v = sag_v, set_v

    @property
    def empty(self) -> bool:
        """True if no energy is left: the motors stop."""
        return self.energy_wh <= 0.0

    @property
    def full(self) -> bool:
        """True if it was not drawn from since the last swap."""
        return self.energy_wh >= self.capacity_wh

    @property
    def remaining_share(self) -> float:
        """0 to 1, as the autopilot counts."""
        return (self.energy_wh + self._unnoticed_wh) / self.capacity_wh

    @property
    def remaining_percent(self) -> int:
        """0 to 100, cut as an ArduPilot does."""
        return int(100.0 * self.remaining_share + 1e-9)

    @property
    def consumed_wh(self) -> float:
        """Energy taken from this pack."""
        return self.capacity_wh - self.energy_wh - self._unnoticed_wh

    @property
    def voltage_v(self) -> float:
        """Open-circuit voltage by charge, less what the load drops."""
        cells = CELLS - self._dead_cells
        charge = self.energy_wh / (self.capacity_wh * (cells / CELLS))
        rest = cells * (_CELL_EMPTY_V + (_CELL_FULL_V - _CELL_EMPTY_V) * charge)
        rest = max(_LOWEST_V, (self._set_v or rest) - self._sag_v)
        return rest - _RESISTANCE_OHM * self.power_w / rest

    @property
    def current_a(self) -> float:
        """Load current."""
        return self.power_w / self.voltage_v

    @property
    def capacity_mah(self) -> float:
        """Rated charge, at the middle voltage."""
        return 1000.0 * self.capacity_wh / _NOMINAL_V
