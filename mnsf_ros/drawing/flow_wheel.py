"""Colors for flow seen from above: direction is the hue, speed is the saturation."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

Color = tuple[float, float, float]

WHITE: Final[Color] = (1.0, 1.0, 1.0)
_WHEEL_PIXELS: Final = 161


def flow_colors(
    flow: NDArray[Any], full_speed_m: float, *, neutral: Color = WHITE
) -> NDArray[np.float64]:
    """Returns the colour of each flow vector.

    Red is +x (forward), then around through yellow-green (+y, left), cyan (-x) and violet (-y).
    Opposite directions have opposite hues. The colour fades to neutral as the vector shortens.

    Args:
        flow: (N, 2) or wider, metres; only x and y are looked at.
        full_speed_m: Length of a vector that gets its full color, metres, above 0. Longer
            vectors look the same.
        neutral: RGB of the zero vector, and of vectors that are not finite, each 0 to 1.

    Returns:
        (N, 3) RGB, each 0 to 1.
    """
    x, y = flow[:, 0].astype(np.float64), flow[:, 1].astype(np.float64)
    speeds = np.hypot(x, y)
    strengths = np.clip(speeds / full_speed_m, 0.0, 1.0)
    finite = np.isfinite(speeds)
    strengths[~finite] = 0.0
    sixths = np.where(finite, np.arctan2(y, x), 0.0) * (3.0 / np.pi)  # hue, 6 is a full turn
    # Red, green and blue are the same hat over the hue, a third of a turn apart.
    from_peak = np.abs((sixths[:, None] - [0.0, 2.0, 4.0] + 3.0) % 6.0 - 3.0)
    hues = np.clip(2.0 - from_peak, 0.0, 1.0)
    colors: NDArray[np.float64] = np.asarray(neutral) + strengths[:, None] * (hues - neutral)
    return colors


def wheel_image(num_pixels: int = _WHEEL_PIXELS, *, neutral: Color = WHITE) -> NDArray[np.float64]:
    """Returns the wheel itself, x to the right and y up, full colour on its rim.

    Args:
        num_pixels: Width and height P of the picture.
        neutral: RGB of its center, each 0 to 1.

    Returns:
        (P, P, 4) RGBA, each 0 to 1, first row on top, transparent outside of the wheel.
    """
    across = np.linspace(-1.0, 1.0, num_pixels)
    x, y = np.meshgrid(across, across[::-1])
    colors = flow_colors(np.column_stack([x.ravel(), y.ravel()]), 1.0, neutral=neutral)
    # The rim fades over one pixel, so that it is not jagged.
    pixels_inside = (1.0 - np.hypot(x, y)) * (num_pixels / 2)
    opacities = np.clip(pixels_inside, 0.0, 1.0)
    return np.concatenate([colors.reshape(num_pixels, num_pixels, 3), opacities[..., None]], axis=2)


def draw_wheel(
    axes: Axes, full_speed_m: float, *, neutral: Color = WHITE, ink: str = "black"
) -> None:
    """Draws the wheel as a legend, with the speed of its rim below.

    Args:
        axes: Where; should be square. Its frame and ticks are taken away.
        full_speed_m: Speed of the rim, metres per sweep.
        neutral: RGB of the center, each 0 to 1.
        ink: Color of the writing.
    """
    axes.set_axis_off()
    axes.imshow(wheel_image(neutral=neutral), extent=(-1, 1, -1, 1), interpolation="bilinear")
    axes.set(xlim=(-1.05, 1.05), ylim=(-1.05, 1.05), aspect="equal")
    arrow = {"arrowstyle": "-|>", "color": ink, "linewidth": 1.0, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", xy=(1.0, 0.0), xytext=(0.0, 0.0), arrowprops=arrow)
    below: dict[str, Any] = {"color": ink, "fontsize": 9, "ha": "center", "va": "top"}
    axes.text(0.0, -1.15, f"rim: {full_speed_m:g} m\nper sweep", **below)
