"""Which geoms of a model may touch, and the numbers of their contacts: MuJoCo's own rules.

MuJoCo finds geoms that may touch anew in every step. A list of them that is made once gives the
same contacts: `list_contacts` writes one, `refresh` keeps its numbers those of the geoms.
"""

from collections.abc import Callable

import mujoco
import numpy as np

Mix = Callable[[np.ndarray, np.ndarray], np.ndarray]  # numbers of geoms -> those of contacts

LISTED = "floor/contact_"  # no object can be called floor, so no file has such a name


def list_contacts(spec: mujoco.MjSpec, at_most: int) -> mujoco.MjModel:
    """Compile a model that has a list of its contacts in place of MuJoCo's search for them.

    Args:
        spec: what is compiled. The list is written into it.
        at_most: geom pairs. Where there are more, or contacts stick, MuJoCo goes on to search.
    """
    if spec.compiler.discardvisual:  # now: what is in a list counts as no visual
        spec.discard_visual()
        spec.compiler.discardvisual = False
    model = spec.compile()
    pairs = possible(model)
    if len(pairs) > at_most or model.flg_adhesion:
        return model
    geoms = {geom.id: geom for geom in spec.geoms}
    for number, geom in geoms.items():
        geom.name = geom.name or f"{LISTED}geom_{number}"
        geom.contype = geom.conaffinity = 0
    for number, (one, other) in enumerate(pairs.tolist()):
        spec.add_pair(
            name=f"{LISTED}{number}", geomname1=geoms[one].name, geomname2=geoms[other].name
        )
    model = spec.compile()
    refresh(model)
    return model


def possible(model: mujoco.MjModel) -> np.ndarray:
    """Pairs of geoms (P, 2) that MuJoCo would let touch each other, those it was given left out."""
    body, kind, count = model.geom_bodyid, model.geom_contype, model.ngeom
    one, other = np.triu_indices(count, 1)
    bits = (kind[one] & model.geom_conaffinity[other]) | (kind[other] & model.geom_conaffinity[one])
    weld = model.body_weldid[body]
    parent = model.body_weldid[model.body_parentid[weld]]
    still = (weld[one] == 0) | (weld[other] == 0)  # what is fixed to the world touches its children
    kin = (weld[one] == parent[other]) | (weld[other] == parent[one])
    moves = model.body_treeid[body] >= 0
    may = (bits != 0) & (weld[one] != weld[other]) & (still | ~kin) & (moves[one] | moves[other])
    bodies = np.sort(np.stack((body[one], body[other]), axis=1), axis=1)
    may &= ~np.isin((bodies[:, 0] << 16) + bodies[:, 1], model.exclude_signature)
    given = np.sort(np.stack((model.pair_geom1, model.pair_geom2), axis=1), axis=1)
    may &= ~np.isin(one * count + other, given[:, 0] * count + given[:, 1])
    return np.stack((one[may], other[may]), axis=1)


def refresh(model: mujoco.MjModel) -> None:
    """Give the contacts of a list the numbers that follow from those of the geoms, in place."""
    ours = [i for i in range(model.npair) if model.pair(i).name.startswith(LISTED)]
    one, other = model.pair_geom1[ours], model.pair_geom2[ours]
    rank = np.sign(model.geom_priority[one] - model.geom_priority[other])  # 1: the first decides

    def decided(values: np.ndarray, mixed: Mix) -> np.ndarray:
        first, second = values[one], values[other]
        ranks = rank.reshape(-1, *[1] * (values.ndim - 1))
        return np.where(ranks > 0, first, np.where(ranks < 0, second, mixed(first, second)))

    share = _share(model.geom_solmix[one], model.geom_solmix[other])[:, None]

    def blend(first: np.ndarray, second: np.ndarray) -> np.ndarray:
        return share * first + (1.0 - share) * second

    def reference(first: np.ndarray, second: np.ndarray) -> np.ndarray:
        standard = (first[:, :1] > 0.0) & (second[:, :1] > 0.0)
        return np.where(standard, blend(first, second), np.minimum(first, second))

    model.pair_dim[ours] = decided(model.geom_condim, np.maximum)
    model.pair_friction[ours] = decided(model.geom_friction, np.maximum)[:, [0, 0, 1, 2, 2]]
    model.pair_solref[ours] = decided(model.geom_solref, reference)
    model.pair_solimp[ours] = decided(model.geom_solimp, blend)
    model.pair_solreffriction[ours] = 0.0
    model.pair_margin[ours] = model.geom_margin[one] + model.geom_margin[other]
    model.pair_gap[ours] = model.geom_gap[one] + model.geom_gap[other]


def _share(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Of the first geom in what two of equal priority mix, by their weights."""
    little, less = first < mujoco.mjMINVAL, second < mujoco.mjMINVAL
    whole = np.where(little | less, 1.0, first + second)
    return np.select([little & less, little, less], [0.5, 0.0, 1.0], first / whole)
