"""Name what was left out: forward, swap and backward search over the library by evidence, with physical priors.

Imports the inference. A newcomer would get wrong: an effect is accepted on evidence beyond its prior odds and dropped
only well below that, so the search cannot run in circles; and one that a near twin explains as well is reported as a
class, with what would decide.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from glider_jax.diagnosis.candidates import Candidate, Looks, Variant
from glider_jax.diagnosis.rest import calibrations_of_flight, rested, strayed
from glider_jax.inference.fit import TIDES, Linear, Problem, heaving, linearise, rows_of, stack
from glider_jax.inference.noise import fit_noise
from glider_jax.records import Array

#: nats: evidence beyond prior odds that accepts, below which an accepted one is dropped, that a swap must gain, and
#: within which alternatives are reported.
ACCEPT, DROP, SWAP, ALIKE = 4.3, 3.3, 1.0, 3.0
#: nats beyond which the noise law need not be asked again.
CLEAR = 25.0
#: nats beyond which a single effect need not be taken out again to be believed, nor rivals be fitted in its place.
BEYOND = 100.0
MOST_EFFECTS, MOST_MOVES = 6, 14
#: Effects that are judged where they come to rest, at most, before they are accepted and in the place of one that was.
MOST_BENT, MOST_RIVALS = 3, 5


@dataclass(frozen=True)
class Pick:
    """An accepted candidate, its best variant and the evidence for it in nats.

    ``looked`` is what averaging over its shapes costs against the best one alone, nats, at most 0.
    """

    candidate: Candidate
    variant: Variant
    evidence: float
    looked: float = 0.0


class Search:
    """State of a search: the problem, its linearisation and what was accepted so far."""

    def __init__(self, problem: Problem, progress=lambda text: None, independent: bool = False):
        self.independent = independent
        self.problem = problem
        self.looks = Looks(problem)
        self.progress = progress
        self.picks: list[Pick] = []
        self.path: list[str] = []
        self.linear: Linear | None = None
        self.firsts: dict[str, float] = {}
        self.known: dict[tuple, tuple[float, Array]] = {}
        self.kept: set[tuple[str, str]] = set()
        self.opened = 0.0
        self.early: dict[str, float] = {}

    def run(self) -> None:
        """Search until nothing more is worth accepting, dropping or swapping."""
        self.progress("derivatives of every effect")
        self.looks.prepare()
        self.relinearise(harden=2)
        self.early = {c.id: self._gain(c, self.fixed, self.base)[0] for c in self.candidates}
        # Calibrations and nuisances are not all linear: once more where they came to rest.
        self.relinearise()
        self.firsts = {c.id: self._gain(c, self.fixed, self.base)[0] for c in self.candidates}
        self.go_on()

    def go_on(self) -> None:
        """Move until nothing more is worth it; what was dropped or taken back is not accepted again."""
        for _ in range(MOST_MOVES):
            if not self._move():
                break
            self.progress(f"accepted: {', '.join(p.candidate.id for p in self.picks) or 'nothing'}")
            self.relinearise()
        self.refine()

    def _gone(self, id: str) -> bool:
        """Whether an effect was dropped or taken back."""
        return self._back(id) or any(line.startswith(f"dropped {id} ") for line in self.path)

    def _back(self, id: str) -> bool:
        """Whether held-out dives spoke against an effect."""
        return any(line.startswith(f"took back {id}:") for line in self.path)

    def allowed(self, candidate: Candidate) -> bool:
        """Whether the search may name a candidate."""
        return True

    def refine(self) -> None:
        """Go on at the accepted set until nothing changes; what is worth nothing there is dropped."""
        for _ in range(MOST_EFFECTS):
            if not self.picks:
                return
            self.relinearise(learn_noise=False)
            if not self.prune():
                return

    def relinearise(self, harden: int = 0, learn_noise: bool = True) -> None:
        """Step to the fitted values of the accepted effects and make the linear problem anew there."""
        if self.linear is not None:
            self._step()
        if learn_noise:
            self.known, self.kept = {}, set()
        periods = tuple(t for t in TIDES if t < self.looks.duration)
        beside = stack(
            self.problem, {"vertical speed": heaving(self.problem.gathered, periods, 0.01)}, 2 * len(periods)
        ) if self.problem.gathered.stream("vertical speed") is not None else None  # fmt: skip
        self.linear = linearise(
            self.problem,
            self.looks,
            harden=harden,
            learn_noise=learn_noise,
            integrate=beside,
            independent=self.independent,
        )
        opened = sum(float(np.sum(noise.open)) for noise in self.problem.noises)
        if opened != self.opened:
            # Sets are compared on the same rows alone.
            self.known, self.opened = {}, opened
        self.candidates = [c for c in self.looks.candidates(self.linear.labels) if self.allowed(c)]
        kinds = [
            self.problem.replay.unknowns[c.unknown].kind if c.unknown >= 0 else "fixed" for c in self.linear.labels
        ]
        self.fixed = [
            i for i, kind in enumerate(kinds) if kind != "candidate" and self.linear.labels[i].term != "shift"
        ]
        self._rebind()
        self.base = self.linear.score(self.fixed)

    def _step(self) -> None:
        """Set the unknowns to their posterior means under the accepted set; everything else to its centre."""
        _, self.problem.values = self._fitted(self.picks)
        self.problem.shapes = {k: v for pick in self.picks for k, v in pick.variant.shapes.items()}

    def _rebind(self) -> None:
        """Point the accepted effects at the unknowns' own columns, which now stand at their shapes."""
        fresh = []
        for pick in self.picks:
            candidate = next(c for c in self.candidates if c.id == pick.candidate.id)
            own = {self.linear.labels[i].unknown for i in pick.variant.columns}
            columns = tuple(
                i for i, c in enumerate(self.linear.labels) if c.variant == 0 and c.unknown in own
            )  # fmt: skip
            variant = Variant(columns, 0.0, pick.variant.shapes, pick.variant.width)
            fresh.append(replace(pick, candidate=candidate, variant=variant))
            self.linear.precision[list(columns)] = variant.width**-2.0
        self.picks = fresh

    @property
    def plain(self) -> list[int]:
        """Columns of calibrations and nuisances, without what a glide model may be wrong by."""
        return [i for i in self.fixed if self.linear.labels[i].term != "inadequacy"]

    @property
    def active(self) -> list[int]:
        """Columns of calibrations, nuisances and accepted effects."""
        return self.fixed + [i for pick in self.picks for i in pick.variant.columns]

    def _gain(self, candidate: Candidate, active: list[int], base: float) -> tuple[float, Variant]:
        """Evidence of adding a candidate, its shapes averaged out, and its best variant."""
        scores = []
        for variant in candidate.variants:
            if np.abs(self.linear.gram[list(variant.columns), list(variant.columns)]).max() < 1e-6:
                scores.append(-1e-9 + variant.log_weight)
                continue
            scores.append(self._score(variant, active) - base + variant.log_weight)
        best = int(np.argmax(scores))
        return float(np.logaddexp.reduce(scores)) + candidate.log_odds, candidate.variants[best]

    def _score(self, variant: Variant, active: list[int]) -> float:
        """Evidence of some active columns with a variant; none where its amplitude comes out elsewhere than looked."""
        score, mean, _ = self._judged(variant, active)
        low, high = variant.cell
        return score if low <= mean[-1] <= high else -np.inf

    def _judged(self, variant: Variant, active: list[int]) -> tuple[float, Array, float]:
        columns = list(variant.columns)
        known = np.append(self.linear.precision[active], np.full(len(columns), variant.width**-2.0))
        return self.linear.judged(active + columns, known, variant.shift)

    def _without(self, k: int) -> list[int]:
        return self.fixed + [i for n, pick in enumerate(self.picks) if n != k for i in pick.variant.columns]

    def losses(self) -> list[float]:
        """Evidence that each accepted effect would cost to drop, prior odds and looks elsewhere included.

        Each set, with and without, is judged where its own fit comes to rest: extrapolated from the fitted values an
        effect that is far from linear would seem to be worth more than it is.
        """
        near = [self._worth(k) for k in range(len(self.picks))]
        if len(near) == 1 and near[0] > BEYOND:
            candidate = self.picks[0].candidate
            # Of one far from linear, what it was worth before it was accepted, where that is beyond doubt too.
            seen = self.firsts.get(candidate.id, 0.0) if _from_afar(candidate) else near[0]
            if seen > BEYOND:
                return [min(seen, near[0])]
        whole = self._rest(self.picks)
        return [
            whole - self._rest([p for p in self.picks if p is not pick]) + pick.candidate.log_odds + pick.looked
            for pick in self.picks
        ]

    def _worth(self, k: int) -> float:
        """Evidence for an accepted effect beside the others in the linear problem as it stands."""
        pick = self.picks[k]
        gain = self.linear.score(self.active) - self.linear.score(self._without(k))
        return gain + pick.candidate.log_odds + pick.looked

    def _rest(self, picks: list[Pick]) -> float:
        """Evidence of some effects at their converged fit, under the noise as it is."""
        return self._fitted(picks)[0]

    def _fitted(self, picks: list[Pick]) -> tuple[float, Array]:
        """The same and the values there, found once under one noise."""
        key = tuple(
            sorted((p.candidate.id, p.variant.width, tuple(sorted(p.variant.shapes.items()))) for p in picks)
        )
        if key not in self.known:
            self.known[key] = self._converged(picks)
        return self.known[key]

    def _converged(self, picks: list[Pick]) -> tuple[float, Array]:
        return rested(self.problem, self.linear, self.fixed, picks)

    def alternatives(self, k: int) -> list[tuple[str, float]]:
        """Effects that would explain as well in place of an accepted one: id and nats behind it (negative: ahead)."""
        without = self._without(k)
        base = self.linear.score(without)
        mine = self._worth(k)
        taken = {pick.candidate.id for pick in self.picks}
        found = []
        for candidate in self.candidates:
            if candidate.id not in taken:
                gain, _ = self._gain(candidate, without, base)
                if gain > 1.0 and mine - gain < ALIKE:
                    found.append((candidate.id, mine - gain))
        return sorted(found, key=lambda pair: pair[1])

    def rivals(self, k: int) -> list[tuple[str, float]]:
        """Alternatives of an accepted effect; those that the linear problem cannot compare where their fits rest."""
        judged = {pick.candidate.id: behind for pick, behind in self.at_rest(k)}
        found = {**dict(self.alternatives(k)), **judged}
        return sorted(((id, behind) for id, behind in found.items() if behind < ALIKE), key=lambda pair: pair[1])

    def at_rest(self, k: int) -> list[tuple[Pick, float]]:
        """Effects of the flight in the place of an accepted one, and by how many nats each rests behind it.

        Of an effect far from linear the linear problem at its fitted value does not tell what is left without it. Where
        either is looked at from afar, those worth a name before anything was accepted are fitted in its place, unless
        it is far beyond doubt: there fits are slow, and none comes near.
        """
        pick, taken = self.picks[k], {one.candidate.id for one in self.picks}
        worth = {id: max(gain, self.firsts.get(id, 0.0)) for id, gain in self.early.items()}
        likely = [
            c for c in sorted(self.candidates, key=lambda c: -worth.get(c.id, 0.0))
            if worth.get(c.id, 0.0) > ACCEPT and c.id not in taken and self._moves_flight(c)
            and (_from_afar(c) or _from_afar(pick.candidate))
        ]  # fmt: skip
        if not likely or not self._moves_flight(pick.candidate) or self._worth(k) > BEYOND:
            return []
        without, others = self._without(k), [one for one in self.picks if one is not pick]
        base = self.linear.score(without)
        mine = self._rest(self.picks) + pick.candidate.log_odds + pick.looked
        found = [self.pick(candidate, without, base) for candidate in likely[:MOST_RIVALS]]
        return [(one, mine - self._rest([*others, one]) - one.candidate.log_odds - one.looked) for one in found]

    def prune(self) -> bool:
        """Drop accepted effects that lost their evidence, the weakest first; whether any was."""
        before = len(self.picks)
        while self.picks:
            losses = self.losses()
            worst = int(np.argmin(losses))
            doubted = losses[worst] < CLEAR and not self._still(worst)
            if losses[worst] >= DROP and not doubted:
                break
            self.path.append(f"dropped {self.picks[worst].candidate.id} ({losses[worst]:.1f} nats)")
            del self.picks[worst]
            self.relinearise(learn_noise=False)
        return len(self.picks) < before

    def _still(self, k: int) -> bool:
        """Whether an accepted effect is still better than the noise that its absence would ask for."""
        pick = self.picks[k]
        picks, self.picks = self.picks, [p for p in self.picks if p is not pick]
        stands = self._stands(pick, DROP)
        self.picks = picks
        return stands

    def _move(self) -> bool:
        """One backward, swap or forward move; False where none is worth it."""
        if self.picks:
            losses = [self._worth(k) for k in range(len(self.picks))]
            worst = int(np.argmin(losses))
            if losses[worst] < DROP:
                self.path.append(f"dropped {self.picks[worst].candidate.id} ({losses[worst]:.1f} nats)")
                del self.picks[worst]
                return True
            for k in range(len(self.picks)):
                better = [a for a in self.alternatives(k) if a[1] < -SWAP and not self._back(a[0])]
                if better and self._swap(k, better[0][0]):
                    return True
        taken = {pick.candidate.id for pick in self.picks}
        if len(self.picks) >= MOST_EFFECTS:
            return False
        active = self.active
        base = self.linear.score(active)
        left = [c for c in self.candidates if c.id not in taken and not self._gone(c.id)]
        gains = [(self._gain(c, active, base), c) for c in left]
        for (gain, _), candidate in sorted(gains, key=lambda pair: -pair[0][0])[:3]:
            if gain > ACCEPT and (gain > CLEAR or self._stands(self.pick(candidate, active, base))):
                break
        else:
            return self._unbend(active)
        picked = self._against_far(self.pick(candidate, active, base), gains)
        candidate, gain = picked.candidate, picked.evidence
        self.path.append(f"accepted {picked.candidate.id} ({gain:.1f} nats)")
        self.picks.append(picked)
        return True

    def _against_far(self, best: Pick, gains: list) -> Pick:
        """The best of the next effects: of those that move the flight, one that was looked at away from zero is judged
        against it where each comes to rest, since the linear problem tells little of it.
        """
        active, base = self.active, self.linear.score(self.active)
        for (gain, variant), rival in gains if self._moves_flight(best.candidate) else []:
            if rival is best.candidate or variant.shift < 0 or gain <= ACCEPT:
                continue
            other = self.pick(rival, active, base)
            ahead = self._rest([*self.picks, other]) - self._rest([*self.picks, best])
            if ahead + rival.log_odds + other.looked > best.candidate.log_odds + best.looked:
                best = other
        return best

    def _unbend(self, active: list[int]) -> bool:
        """Accept the best effect that calibrations of the flight stand for; False where there is none.

        A calibration that strays as far as a name would cost bends the problem: from there the linear one no longer
        sees the effect that would bring it back. Effects that were worth a name at the vehicle file's own numbers are
        judged where each one's fit comes to rest, begun at those numbers.
        """
        where, centres = self.problem.values.copy(), self.problem.centres()
        own = calibrations_of_flight(self.problem)
        if strayed(self.problem, where) < ACCEPT:
            return False
        taken = {pick.candidate.id for pick in self.picks}
        taken |= {line.split()[1] for line in self.path if " at rest: " in line}
        likely = [c for c in self.candidates if c.id not in taken and not self._gone(c.id) and self._moves_flight(c)]
        likely = sorted((c for c in likely if self.early.get(c.id, 0.0) > ACCEPT), key=lambda c: -self.early[c.id])
        given = where.copy()
        given[own] = centres[own]
        score = self.linear.score(active)
        base = max(self._from(self.picks, start)[0] for start in (where, given)) if likely else 0.0
        found = [self._at_rest(self.pick(c, active, score), given, base) for c in likely[:MOST_BENT]]
        for pick, there in sorted(found, key=lambda pair: -pair[0].evidence):
            if pick.evidence <= ACCEPT:
                break
            before, kept = self._asked(), self._state()
            self.picks, self.problem.values = [*self.picks, pick], there
            self.relinearise(learn_noise=False)
            gain = self._asked() - before + pick.candidate.log_odds + pick.looked
            if gain > ACCEPT:
                self.path.append(f"accepted {pick.candidate.id} at rest ({pick.evidence:.1f} nats)")
                return True
            self.path.append(f"refused {pick.candidate.id} at rest: larger noise explains as much ({gain:.1f} nats)")
            self._restore(kept)
        return False

    def _state(self) -> tuple:
        """All that a fit of another set would change."""
        return self.picks, self.linear, self.candidates, self.fixed, self.base, self.problem.values, self.problem.shapes

    def _restore(self, kept: tuple) -> None:
        self.picks, self.linear, self.candidates, self.fixed, self.base = kept[:5]
        self.problem.values, self.problem.shapes = kept[5:]

    def _moves_flight(self, candidate: Candidate) -> bool:
        labels, unknowns = self.linear.labels, self.problem.replay.unknowns
        return any("flight" in unknowns[labels[i].unknown].groups for i in candidate.variants[0].columns)

    def _at_rest(self, pick: Pick, given: Array, base: float) -> tuple[Pick, Array]:
        """A pick judged where its fit comes to rest, and the values there; of its widths the middle one stands for all.

        Each fit costs as much as a move of the search, and what the other widths would add is little.
        """
        variants = [v for v in pick.candidate.variants if v.shapes == pick.variant.shapes and v.shift < 0]
        variant = sorted(variants, key=lambda v: v.width)[len(variants) // 2]
        score, rested = self._from([*self.picks, replace(pick, variant=variant)], given)
        evidence = score - base + variant.log_weight + pick.candidate.log_odds
        return Pick(pick.candidate, variant, evidence, variant.log_weight), rested

    def _from(self, picks: list[Pick], start: Array) -> tuple[float, Array]:
        """Evidence of some effects and the values they rest at, begun at some values."""
        where, self.problem.values = self.problem.values, start
        found = self._converged(picks)
        self.problem.values = where
        return found

    def _asked(self) -> float:
        """Evidence of the accepted set under the noise law that it asks for itself."""
        total = self.linear.judged(self.active)[2]
        width = self.linear.precision[self.active] ** -0.5
        for noise, rows in zip(self.problem.noises, rows_of(self.problem), strict=True):
            kept = noise.sizes.copy()
            total += fit_noise(noise, self.linear.raw[rows], self.linear.raw_columns[rows][:, self.active] * width)
            noise.sizes = kept
        return total

    def pick(self, candidate: Candidate, active: list[int], base: float) -> Pick:
        """A candidate with its best variant, as it looks beside some active columns."""
        gain, variant = self._gain(candidate, active, base)
        alone = self._score(variant, active) - base + candidate.log_odds
        return Pick(candidate, variant, gain, min(gain - alone, 0.0))

    def _stands(self, pick: Pick, least: float = ACCEPT) -> bool:
        """Whether a weak pick is also better than the noise law that its absence asks for.

        The noise was sized with the whole library integrated out; without the candidate it may be larger, and explain
        the same.
        """
        if self.independent:
            return True
        candidate, variant = pick.candidate, pick.variant
        share = self._judged(variant, self.active)[2] - self.linear.judged(self.active)[2]
        total = candidate.log_odds + pick.looked + share
        columns = list(variant.columns)
        width = np.append(self.linear.precision[self.active] ** -0.5, np.full(len(columns), variant.width))
        for noise, rows in zip(self.problem.noises, rows_of(self.problem), strict=True):
            mine = self.linear.raw_columns[rows]
            if np.abs(self.linear.columns[rows][:, columns]).max() < 1e-6:
                continue
            kept = noise.sizes.copy()
            reached = []
            for active in (self.active, self.active + columns):
                noise.sizes = kept.copy()
                left = self.linear.raw[rows]
                if variant.shift >= 0 and len(active) > len(self.active):
                    left = left - mine[:, variant.shift]
                reached.append(fit_noise(noise, left, mine[:, active] * width[: len(active)]))
            noise.sizes = kept
            total += reached[1] - reached[0]
        if total <= least:
            self.path.append(f"refused {candidate.id}: larger noise explains as much ({total:.1f} nats)")
        return total > least

    def _swap(self, k: int, id: str) -> bool:
        line = f"swapped {self.picks[k].candidate.id} for {id}"
        back = f"swapped {id} for {self.picks[k].candidate.id}"
        if any(done.startswith((line, back)) for done in self.path):
            return False
        if (self.picks[k].candidate.id, id) in self.kept:
            return False
        candidate = next(c for c in self.candidates if c.id == id)
        without = self._without(k)
        mine, other = self.picks[k], self.pick(candidate, without, self.linear.score(without))
        changed = [other if p is mine else p for p in self.picks]
        gain = self._rest(changed) - self._rest(self.picks)
        gain += candidate.log_odds + other.looked - mine.candidate.log_odds - mine.looked
        if gain < SWAP:
            self.path.append(f"kept {mine.candidate.id} before {id} ({gain:.1f} nats)")
            self.kept.add((mine.candidate.id, id))
            return False
        self.path.append(f"{line} ({gain:.1f} nats)")
        self.picks = changed
        return True


def _from_afar(candidate: Candidate) -> bool:
    """Whether an effect is so far from linear that it is looked at away from zero too."""
    return any(variant.shift >= 0 for variant in candidate.variants)
