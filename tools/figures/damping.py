"""Draw docs/systems/figures/damping.png: evolving spectra of a synthetic decay with known damping ratios.

Run ``python -m tools.figures.damping``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from diagnosis.decay.evolving_spectra import evolving_spectra
from diagnosis.recordings.columns import Vector
from engine.files import writing
from flexarm.plotting.decay import draw_decay, draw_waterfall

TARGET = Path(__file__).resolve().parents[2] / "docs" / "systems" / "figures" / "damping.png"
MODES = ((7.622, 0.0315, 1.0), (47.77, 0.0068, 0.2))
"""Frequency (Hz), damping ratio and amplitude (mm) of the two modes."""


def synthetic(rate: float = 10e3, length: float = 1.0) -> tuple[Vector, Vector]:
    """Two decaying modes with 0.2 % of white noise: time (s) and deflection (mm)."""
    time = np.arange(round(rate * length)) / rate
    values = 0.002 * np.random.default_rng(1).standard_normal(len(time))
    for frequency, ratio, amplitude in MODES:
        w = 2 * np.pi * frequency
        values += amplitude * np.exp(-ratio * w * time) * np.cos(w * np.sqrt(1 - ratio**2) * time)
    return time, values


def draw(target: Path = TARGET) -> Path:
    """Waterfall and amplitudes of the synthetic decay."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    from diagnosis.decay.record import decay_record

    time, values = synthetic()
    record = decay_record(time, values, name="tip", unit="mm")
    found = evolving_spectra(record, None, [mode[0] for mode in MODES], window=0.4, hop=0.05, windows=10)
    with writing(target, (".png",)) as temporary, mpl.rc_context({"grid.color": "#dddddd", "grid.linewidth": 0.6}):
        figure = plt.figure(figsize=(10.5, 4.4), layout="constrained")
        left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=(1.25, 1))[0]
        draw_waterfall(left.add_subplot(projection="3d", computed_zorder=False), found)
        draw_decay(right.subplots(), found)
        figure.savefig(temporary, dpi=80)
        plt.close(figure)
    return target


if __name__ == "__main__":
    print(draw())
