"""Draw docs/figures/tracks_*.svg: the simulated tracks against the closed forms.

pip install matplotlib
python scripts/plot_certificate.py
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np

from simloop import certify
from simloop.certify.checks import Check
from simloop.cli.edge import run_script
from simloop.physics import track_theory as theory
from simloop.physics import turning_theory

FIGURES = Path(__file__).resolve().parent.parent / "docs" / "figures"
GAUGE_M, LENGTH_M, MODULUS_M = 0.39, 0.415, 0.001


def checks(family: str, start: str) -> list[tuple[float, Check]]:
    """Run the checks of a family, and select those whose names are a prefix and a number.

    Args:
        family: name of the family in the certificate.
        start: prefix of the names.

    Returns:
        The numbers with their checks.
    """
    found = []
    for check in certify.run([family]):
        if check.name.startswith(start):
            number = check.name.removeprefix(start).split()[0].strip(",:")
            found.append((float(number), check))
    return found


def save(axes: matplotlib.axes.Axes, name: str) -> None:
    """Write one figure. The file has the same bytes each time.

    Args:
        axes: the figure's axes.
        name: name of the file, without extension.
    """
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    axes.figure.tight_layout()
    axes.figure.savefig(FIGURES / f"{name}.svg", metadata={"Date": None})


def spin(axes: matplotlib.axes.Axes) -> None:
    """Draw the spin ratio over L/B, with that of MuJoCo's own friction.

    Args:
        axes: the axes to draw on.
    """
    ratios = np.linspace(0.6, 2.6, 80)
    closed = [turning_theory.spin_ratio(ratio * GAUGE_M, GAUGE_M) for ratio in ratios]
    axes.plot(ratios, closed, "k-", lw=1, label="closed form, B F = 2 m")
    points = checks("spin", "L/B ")
    axes.plot([x for x, _ in points], [c.value for _, c in points], "o", label="simloop")
    native = [c.value for c in certify.run(["native"]) if "spin ratio" in c.name]
    at = [LENGTH_M / GAUGE_M] * len(native)
    axes.plot(at, native, "rx", label="MuJoCo's own friction")
    axes.set(xlabel="contact length / gauge", ylabel="spin ratio", ylim=(0, 1))


def slip(axes: matplotlib.axes.Axes) -> None:
    """Draw the pull over the slip.

    Args:
        axes: the axes to draw on.
    """
    slips = np.geomspace(3e-4, 1, 100)
    closed = [theory.drawbar_ratio(i, LENGTH_M, MODULUS_M) for i in slips]
    axes.semilogx(slips, closed, "k-", lw=1, label="Janosi-Hanamoto")
    bilinear = [theory.drawbar_ratio_bilinear(i, LENGTH_M, MODULUS_M) for i in slips]
    axes.semilogx(slips, bilinear, "k:", lw=1, label="bilinear brush")
    towed = [c for _, c in checks("slip", "towed by ")]
    shares = [float(c.name.split()[2]) for c in towed]
    axes.plot([c.value for c in towed], shares, "o", label="simloop, towed by a force")
    winched = checks("slip", "winch, slip ")
    axes.plot(
        [theory.slip_at_drawbar(c.expected, LENGTH_M, MODULUS_M) for _, c in winched],
        [c.value for _, c in winched], "s", mfc="none", label="simloop, held by a winch",
    )  # fmt: skip
    axes.set(xlabel="slip", ylabel="pull / (mu W)")


def turn(axes: matplotlib.axes.Axes) -> None:
    """Draw the yaw rate of steady turns.

    Args:
        axes: the axes to draw on.
    """
    points = [(x, c) for x, c in checks("turn", "inner/outer ") if "yaw" in c.name]
    axes.plot([x for x, _ in points], [c.expected for _, c in points], "k-", lw=1, label="theory")
    axes.plot([x for x, _ in points], [c.value for _, c in points], "o", label="simloop")
    axes.set(xlabel="inner / outer belt speed", ylabel="yaw rate, rad/s, outer belt 0.12 m/s")


def main() -> None:
    """Draw all figures."""
    matplotlib.use("svg")
    matplotlib.rcParams.update({"svg.hashsalt": "simloop", "svg.fonttype": "none"})
    from matplotlib import pyplot

    FIGURES.mkdir(exist_ok=True)
    for draw in (spin, slip, turn):
        _, axes = pyplot.subplots(figsize=(5.2, 3.4))
        draw(axes)
        save(axes, f"tracks_{draw.__name__}")


if __name__ == "__main__":
    run_script(main)
