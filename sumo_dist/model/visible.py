"""What of a model is seen, and how: MuJoCo's rules for whoever draws it."""

import mujoco
import numpy as np

VISIBLE_GROUPS = 3  # geom groups 0, 1, 2 are drawn, as in MuJoCo's own viewer; 3 is collision

_NO_COLOR = np.array([0.5, 0.5, 0.5, 1.0], np.float32)  # MuJoCo's default: the material decides


def drawn(model: mujoco.MjModel) -> np.ndarray:
    """Mask (ngeom,) of the geoms that are drawn: the visible; all, of what would not be seen."""
    clear = np.array([rgba(model, geom)[3] == 0.0 for geom in range(model.ngeom)], bool)
    visible = (model.geom_group < VISIBLE_GROUPS) & ~clear
    things = model.body_rootid[model.geom_bodyid]
    return visible | ~np.isin(things, things[visible])


def rgba(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Return a geom's RGBA (4,) in [0, 1]: its own colour, else its material's."""
    own, material = model.geom_rgba[geom], model.geom_matid[geom]
    return model.mat_rgba[material] if material >= 0 and np.array_equal(own, _NO_COLOR) else own


def height_field(model: mujoco.MjModel, geom: int, lines: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a height field's points (rows, columns, 3) in its frame [m], and triangles (F, 3).

    Args:
        model: that it is of.
        geom: its number.
        lines: rows and columns that are kept, at most; triangles count the points row by row.
    """
    field = model.geom_dataid[geom]
    nrow, ncol, first = model.hfield_nrow[field], model.hfield_ncol[field], model.hfield_adr[field]
    x, y, top, _ = model.hfield_size[field]
    rows, columns = (
        np.unique(np.linspace(0, n - 1, min(n, lines)).round().astype(int)) for n in (nrow, ncol)
    )
    heights = model.hfield_data[first : first + nrow * ncol].reshape(nrow, ncol)
    across, along = np.meshgrid(x * (2 * columns / (ncol - 1) - 1), y * (2 * rows / (nrow - 1) - 1))
    points = np.stack([across, along, top * heights[np.ix_(rows, columns)]], axis=-1)
    corner = np.arange(points[..., 0].size).reshape(points.shape[:2])
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
    return points, np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
