"""Whose tracks are whose: motion through gaps, looks, the best joins and how sure they are."""

import itertools

import numpy as np
import pandas as pd
import pytest
import scipy
from scratch import prepare, put_clip
from toy_fish import line, outline, polygon_mask

import stages.extract
import stages.features
import stages.identity
import stages.plots.identity
from finloop.identity import appearance, motion
from finloop.identity.film import IDENTITIES
from finloop.identity.joins import (
    TrackPairs,
    find_best_joins,
    join_in_passes,
    simultaneous_pairs,
    successor_pairs,
)
from finloop.io.numbers import load_numbers
from finloop.io.table import load_table


def table_of(*places):
    """Tracks of these places (k, 2) each, from frame 0 on."""
    return pd.concat([
        pd.DataFrame({"track_id": k, "frame": np.arange(len(one)), "x": one[:, 0], "y": one[:, 1]})
        for k, one in enumerate(places)
    ])  # fmt: skip


@pytest.fixture
def rng():
    return np.random.default_rng(5)


# --- motion


def test_drift_is_none_on_a_straight_way_and_that_of_a_random_walk(rng):
    ways = [np.outer(np.arange(200), (0.1, 0.02 * k)) for k in range(3)]
    straight = motion.measure_drift(table_of(*ways))
    assert straight.mismatch[:-1] == pytest.approx(0, abs=1e-9)
    assert straight.share[:-1] == pytest.approx(1)
    drift = motion.measure_drift(table_of(*np.cumsum(rng.normal(0, 1, (40, 400, 2)), axis=1)))
    # Half of the walks of g steps of spread 1 end within sqrt(2 ln 2 g).
    assert drift.mismatch[:-1] == pytest.approx(np.sqrt(2 * np.log(2) * drift.gaps[:-1]), rel=0.1)
    assert np.all(drift.share[:-1] < 0.1)


def test_the_ratio_of_places_is_that_of_densities(rng):
    """Over the whole tank the density of the same animal adds up to one, as that of any does."""
    drift = motion.GapDrift(np.array([1.0, 2.0]), np.array([1.5, 1.5]), np.zeros(2), 400.0, 4)
    place = rng.uniform(-10, 10, (200_000, 2))
    ratio = np.exp(drift.log_ratio(np.ones(len(place)), np.hypot(*place.T)))
    assert ratio.mean() == pytest.approx(1.0, rel=0.04)
    apart = np.linspace(0, 1.5, 2001)  # half of the places lie within the median error
    ring = 2 * np.pi * apart * np.exp(drift.log_ratio(np.ones(len(apart)), apart)) / drift.tank
    assert np.trapezoid(ring, apart) == pytest.approx(0.5, rel=0.03)


def test_a_track_is_joined_to_one_that_begins_where_it_leads():
    t = np.arange(30.0)
    ways = [np.stack([0.3 * t, 0 * t], 1), np.stack([0.3 * t, 9 - 0.3 * t], 1)]
    before = [(t[:12], way[:12]) for way in ways]
    after = [(t[16:], way[16:]) for way in ways[::-1]]
    frames, places = zip(*before, *after, strict=True)
    ends = motion.measure_track_ends(list(frames), list(places), 4)
    pairs = successor_pairs(ends.start, ends.stop, np.zeros(4, int))
    score = motion.motion_log_ratios(ends, motion.measure_drift(table_of(*ways, *ways)), pairs)
    joins = find_best_joins(4, pairs, score, 0.05, 0.5, np.random.default_rng(0))
    assert joins.predecessor.tolist() == [-1, -1, 1, 0]


# --- joins


def spans_of(rng, tracks=60, cut=300):
    """First and last frames of tracks of a film with a cut, and the segment of each."""
    start = rng.integers(0, 2 * cut, tracks)
    segment = start // cut
    stop = np.minimum(start + rng.integers(0, 60, tracks), (segment + 1) * cut - 1)
    return start, stop, segment


def test_tracks_are_followed_by_the_next_of_their_segment(rng):
    start, stop, segment = spans_of(rng)
    after = (start > stop[:, None]) & (segment == segment[:, None])
    every = successor_pairs(start, stop, segment, len(start))
    assert set(zip(*every, strict=True)) == set(zip(*np.nonzero(after), strict=True))
    some = successor_pairs(start, stop, segment, 5)
    for track in range(len(start)):
        first = np.sort(start[after[track]])[:5]
        np.testing.assert_array_equal(np.sort(start[some.b[some.a == track]]), first)


def test_pairs_at_once_have_a_frame_in_common(rng):
    start, stop, _ = spans_of(rng)
    both = np.triu((start <= stop[:, None]) & (start[:, None] <= stop), 1)
    pairs = list(zip(*simultaneous_pairs(start, stop), strict=True))
    assert sorted(pairs) == list(zip(*np.nonzero(both), strict=True))


def test_the_best_set_of_few_pairs_is_that_of_the_whole_matrix(rng):
    for part in (2, 7, 20):  # tracks that pairs connect: many parts, and one
        a, b = np.nonzero(np.triu(rng.random((20, 20)) < 0.4, 1))
        same = a // part == b // part
        pairs = TrackPairs(a[same], b[same])
        score, stranger = rng.normal(0, 3, same.sum()), 0.2
        before = find_best_joins(20, pairs, score, stranger, 0.0, rng).predecessor
        whole = np.full((20, 40), -1e6)
        whole[pairs] = score - 2 * np.log(stranger)
        whole[np.arange(20), 20 + np.arange(20)] = 0
        at = scipy.optimize.linear_sum_assignment(whole, maximize=True)
        joined = before >= 0
        assert whole[before[joined], joined.nonzero()[0]].sum() == pytest.approx(whole[at].sum())
        assert len(set(before[joined])) == joined.sum()


def test_equal_scores_are_equally_probable(rng):
    pairs, score = TrackPairs(np.array([0, 0, 1, 1]), np.array([2, 3, 2, 3])), np.full(4, 6.0)
    found = find_best_joins(4, pairs, score, 1e-6, 0.3, rng)
    assert sorted(found.predecessor[2:]) == [0, 1]
    assert found.probability[2:] == pytest.approx(0.5, abs=0.15)
    assert (find_best_joins(4, pairs, score, 1e-6, 0.75, rng).predecessor == -1).all()


def test_probabilities_are_near_those_of_all_sets_of_joins(rng):
    ends, starts = range(3), range(3, 6)
    score = np.full((6, 6), -np.inf)
    score[:3, 3:] = rng.normal(2, 2, (3, 3))
    stranger = 0.1
    weight = np.zeros((6, 6))
    total = 0.0
    for pick in itertools.product([None, *starts], repeat=3):
        joined = [(a, b) for a, b in zip(ends, pick, strict=True) if b is not None]
        if len({b for _, b in joined}) < len(joined):
            continue
        alone = 6 - 2 * len(joined)
        one = np.exp(sum(score[join] for join in joined)) * stranger**alone
        total += one
        for join in joined:
            weight[join] += one
    pairs = TrackPairs(*np.nonzero(np.isfinite(score)))
    found = find_best_joins(6, pairs, score[pairs], stranger, 0.01, rng)
    for b in starts:
        if found.predecessor[b] >= 0:
            truth = weight[found.predecessor[b], b] / total
            assert found.probability[b] == pytest.approx(truth, abs=0.15)


def test_tracks_that_are_joined_tell_more_together(rng):
    """Where the first join is made, the second becomes probable; a chain keeps its order."""

    def scores(chains):
        if chains == [[0, 1, 2]]:
            return TrackPairs(np.zeros(0, int), np.zeros(0, int)), np.zeros(0)
        if chains == [[0, 1], [2]]:
            return TrackPairs(np.array([0]), np.array([1])), np.full(1, 20.0)
        pairs = TrackPairs(np.array([0, 1, 0]), np.array([1, 2, 2]))
        return pairs, np.array([20.0, -20.0, -20.0])

    def best_names(count, pairs, log_ratio):
        return find_best_joins(count, pairs, log_ratio, 0.01, 0.5, rng)

    assert best_names(3, *scores([[0], [1], [2]])).predecessor.tolist() == [-1, 0, -1]
    assert join_in_passes(3, scores, 0.9, best_names).predecessor.tolist() == [-1, 0, 1]


def test_where_no_join_is_sure_passes_are_one():
    pairs = TrackPairs(np.array([0, 0, 1, 1]), np.array([2, 3, 2, 3]))

    def best_names(count, pairs, log_ratio):
        return find_best_joins(count, pairs, log_ratio, 1e-6, 0.3, np.random.default_rng(0))

    joins = join_in_passes(4, lambda _: (pairs, np.full(4, 6.0)), 0.9, best_names)
    np.testing.assert_array_equal(joins, best_names(4, pairs, np.full(4, 6.0)))


# --- looks


def looks_of(rng, animals, spread, tracks=30, pictures=20):
    """Tracks of animals that differ by 1 in each number; `spread`: of the pictures of one."""
    animal = np.arange(tracks) % len(animals)
    return animal, [rng.normal(animals[k], spread, (pictures, animals.shape[1])) for k in animal]


def looked_at(tracks, time):
    """The log ratio of all pairs (n, n) of tracks that are seen in one frame each."""
    n = len(tracks)
    pairs = TrackPairs(*np.indices((n, n)).reshape(2, -1))
    at_once = simultaneous_pairs(time, time)
    return appearance.appearance_log_ratios(tracks, at_once, pairs).reshape(n, n)


def test_components_of_some_pictures_describe_them_all(rng, monkeypatch):
    """Where all pictures lie in a few directions, some of them show these."""
    pictures = (rng.normal(0, 1, (300, 3)) @ rng.normal(0, 1, (3, 40))).astype(np.float32)
    apart = []
    for most in (1000, 50):
        monkeypatch.setattr(appearance, "_PICTURES", most)
        found = appearance.appearance_descriptors(rng.random((300, 2)), pictures.__getitem__, 3)
        apart.append(np.linalg.norm(np.diff(found[:, 2:], axis=0), axis=1))
    np.testing.assert_allclose(apart[0] / apart[1], (apart[0] / apart[1]).mean(), rtol=1e-4)


def test_animals_that_differ_are_told_by_their_looks(rng):
    animal, tracks = looks_of(rng, rng.normal(0, 1, (6, 5)), 0.5)
    time = np.arange(30) // 6  # six at a time
    ratio = looked_at(tracks, time)
    other = ~np.eye(30, dtype=bool)
    same = animal[:, None] == animal
    assert (ratio[same & other] > 0).mean() > 0.95
    assert (ratio[~same] < 0).mean() > 0.95


def test_one_track_of_two_animals_leaves_the_others_told(rng):
    animal, tracks = looks_of(rng, rng.normal(0, 1, (6, 5)), 0.5)
    tracks[0][:10] += 100.0
    ratio = looked_at(tracks, np.arange(30) // 6)[1:, 1:]
    same = animal[1:, None] == animal[1:]
    one = np.median(ratio[same & ~np.eye(29, dtype=bool)])
    assert one > 1.0
    assert one > 1.0 + np.median(ratio[~same])


def test_looks_say_nothing_of_animals_that_look_the_same_or_of_few_tracks(rng):
    _, tracks = looks_of(rng, np.zeros((6, 5)), 1.0)
    assert np.abs(looked_at(tracks, np.arange(30) // 6)).max() < 1.0
    _, tracks = looks_of(rng, rng.normal(0, 1, (2, 5)), 0.1, tracks=4)
    assert not looked_at(tracks, np.zeros(4, int)).any()


# --- the stage


def crossing(frames=60):
    """Two fish that swim across one another, under a shallow angle, and are one silhouette there."""
    made, truth = [], []
    for k in range(frames):
        picture = np.full((150, 260), 180.0)
        middles = [(34 + 3.2 * k, 40 + 1.15 * k), (34 + 3.2 * k, 110 - 1.15 * k)]
        for number, (x, y) in enumerate(middles):
            local = line(0.5 * np.sin(0.9 * k + number)) * 0.4
            mask = (
                polygon_mask(outline(local * (1, -1) + (x, y), 2.6 * WIDE), picture.shape) / 255.0
            )
            picture = np.minimum(picture, 180 - 120 * mask)
        made.append(np.rint(picture).astype(np.uint8))
        truth.append(middles)
    return made, np.array(truth)


WIDE = np.sqrt(np.abs(np.sin(np.pi * np.linspace(0, 1, 33) ** 0.7))) + 0.1


def test_fish_that_cross_keep_their_identities(tmp_path, monkeypatch):
    frames, truth = crossing()
    prepare(tmp_path, "extract.min_track_frames=5")
    monkeypatch.chdir(tmp_path)
    put_clip(tmp_path, frames)
    for stage in (stages.extract, stages.features, stages.identity, stages.plots.identity):
        stage.main()
    # `identify_animals` made it
    told = load_table(tmp_path / "data/identity/identities.parquet", IDENTITIES)
    rows = pd.read_parquet(tmp_path / "data/features/features.parquet").merge(told, on="track_id")
    assert len(told) >= 4  # they did touch
    apart = np.abs(truth[rows["frame"], :, 1] - rows["y_px"].to_numpy()[:, None])
    clear = np.abs(truth[rows["frame"], 0, 1] - truth[rows["frame"], 1, 1]) > 12
    of_truth = pd.crosstab(rows["identity"][clear], apart.argmin(1)[clear])
    assert (of_truth.to_numpy() > 0).sum() == 2  # two identities, each of one fish
    numbers = load_numbers(tmp_path / "reports/identity")
    assert numbers["identities"] == 2
    assert numbers["joins"] >= 2
    assert (tmp_path / "reports/film/identity/timeline.png").stat().st_size > 0
