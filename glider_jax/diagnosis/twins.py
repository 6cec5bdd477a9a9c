"""What the data alone cannot tell from a named effect: members of its class that only their size makes unlikely.

Imports NumPy and the physics' declarations. A newcomer would get wrong: an alternative is what is as likely, prior and
all; a twin fits as well and is not likely, because it would have to be many times its usual size. A pilot who knows
that the sensor or the hull is that far off should overrule the name.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from glider_jax.diagnosis.screen import ALIKE
from glider_jax.physics.library import CONFUSION_CLASSES, TERMS_BY_ID
from glider_jax.physics.term import declared
from glider_jax.records import Array

if TYPE_CHECKING:
    from glider_jax.diagnosis.screen import Search


class Twin(NamedTuple):
    """A member of the class of a named effect that the data cannot tell from it.

    ``behind`` : nats by which it fits worse, priors aside. ``value`` : what its largest parameter would have to be, SI;
    ``times`` : that over its typical size.
    """

    id: str
    behind: float
    parameter: str
    value: float
    times: float


def twins(search: Search, mean: Array, k: int) -> list[Twin]:
    """Members of the classes of an accepted effect that move what was measured as it does, beside all else.

    Parameters
    ----------
    mean : fitted values of ``search.active`` columns, prior units.
    k : number of the accepted effect.
    """
    pick = search.picks[k]
    id, own = pick.candidate.id, list(pick.variant.columns)
    rivals = {m for members in CONFUSION_CLASSES.values() if id in members for m in members}
    rivals -= {p.candidate.id for p in search.picks}
    gram, unknowns = search.linear.gram, search.problem.replay.unknowns
    others = [i for i in search.active if i not in own]
    inner = np.linalg.inv(gram[np.ix_(others, others)] + np.diag(search.linear.precision[others]))

    def beside(rows: list[int], columns: list[int]) -> Array:
        return gram[np.ix_(rows, columns)] - gram[np.ix_(rows, others)] @ inner @ gram[np.ix_(others, columns)]

    size = np.array([mean[search.active.index(i)] for i in own])
    strength = float(size @ beside(own, own) @ size)
    found = []
    for candidate in search.candidates:
        if candidate.id not in rivals:
            continue
        columns = list(candidate.variants[0].columns)
        alone = beside(columns, columns)
        if np.min(np.diag(alone)) < 1e-6:
            continue
        shared = beside(columns, own) @ size
        needed = np.linalg.solve(alone + 1e-9 * np.trace(alone) * np.eye(len(columns)), shared)
        behind = 0.5 * (strength - float(shared @ needed))
        if behind > ALIKE:
            continue
        labels = [unknowns[search.linear.labels[i].unknown] for i in columns]
        infos = [declared(TERMS_BY_ID[u.term])[u.name.rsplit(".", 1)[1]] for u in labels]
        values = [u.scale * z for u, z in zip(labels, needed, strict=True)]
        times = [abs(v) / info.prior.sd for v, info in zip(values, infos, strict=True)]
        most = int(np.argmax(times))
        found.append(Twin(candidate.id, max(behind, 0.0), infos[most].name, float(values[most]), float(times[most])))
    return sorted(found, key=lambda one: one.times)


__all__ = ["Twin", "twins"]
