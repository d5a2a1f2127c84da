"""BlueSky's shapes as areas, wherever on the earth they and the ownship are; without BlueSky."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from envs.areas import Circle, Polygon
from eval.bluesky.plugin import area_of


def shape(kind: str, *numbers: float) -> Any:
    """Return what BlueSky has of a shape without limits of height."""
    return SimpleNamespace(
        kind=lambda: kind, coordinates=numbers, bottom=-1e9, top=1e9, name=kind.lower()
    )


@pytest.mark.parametrize("own", [179.0, -179.0, 179.95, 180.0])
@pytest.mark.parametrize(("west", "east"), [(179.9, -179.9), (179.9, 180.1), (-180.1, -179.9)])
@pytest.mark.parametrize("kind", ["BOX", "POLY"])
def test_a_shape_over_the_antimeridian_is_in_one_piece(
    own: float, west: float, east: float, kind: str
) -> None:
    corners = {"BOX": (-1.0, west, 1.0, east), "POLY": (-1.0, west, -1.0, east, 1.0, east)}
    area = area_of(shape(kind, *corners[kind]), 0.0, own)
    assert isinstance(area.shape, Polygon)
    x = np.array(area.shape.outer)[:, 0]
    assert np.ptp(x) == pytest.approx(0.2 * 111_195.0, rel=1e-2)
    away = abs((own + 360.0) % 360.0 - 180.0)
    assert abs(x.mean()) == pytest.approx(away * 111_195.0, abs=12_000.0)


@pytest.mark.parametrize(("own", "centre"), [(179.99, -179.99), (-179.99, 179.99), (8.0, 8.02)])
def test_a_circle_is_beside_the_ownship(own: float, centre: float) -> None:
    area = area_of(shape("CIRCLE", 0.0, centre, 1.0), 0.0, own)
    assert isinstance(area.shape, Circle)
    assert abs(area.shape.x) == pytest.approx(0.02 * 111_195.0, rel=1e-2)
