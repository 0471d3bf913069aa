"""The motion model: rows, splits, learning, errors, files, the stage; laws and known answers.

A made-up table obeys a law that is written down in the test: the network must find it.
"""

import json
import re
import shutil
from contextlib import chdir
from dataclasses import fields, replace
from fractions import Fraction

import numpy as np
import onnx
import onnxruntime
import pandas as pd
import pytest
import scipy
import torch
from constants import with_constants
from scratch import content, prepare, same_but_figures
from tiny_run import copy_of

import finloop.bpn.back_propagation
import finloop.bpn.onnx
import stages.bpn
import stages.plots.bpn
from finloop.base.errors import FinloopError
from finloop.base.settings import settings
from finloop.bpn.back_propagation import (
    draw_first_weights,
    learn_epoch,
    model_from_weights,
    split_layers,
    train_motion_model,
    unit_output,
)
from finloop.bpn.held_out import assess_model, count_confusions, predict_by_linear_fit, state_errors
from finloop.bpn.model import (
    INPUTS,
    MARGIN,
    OUTPUTS,
    MotionModel,
    find_input_range,
    pair_rows_with_later,
    restore_motion_model,
    round_swimming_types,
    scale_to_unit,
    split_by_blocks,
    split_by_tracks,
    split_rows,
)
from finloop.bpn.onnx import (
    INPUT_NAME,
    OUTPUT_NAME,
    build_onnx_model,
    export_onnx_bytes,
    largest_output_difference,
)
from finloop.features.table import FEATURES
from finloop.io.numbers import load_numbers
from finloop.io.picture import load_picture, save_figure
from finloop.io.record import load_record, save_json
from finloop.io.table import save_table
from finloop.io.video import FACTS_NAME, VideoFacts, save_facts
from finloop.plots.bpn import draw_held_out_predictions, figure15

DELTA = 5
HOW = settings("bpn", learning_rate=0.5, epochs=40)


def rng(seed=0):
    return np.random.default_rng(seed)


def random_inputs(count, seed=0):
    """States and controls (n, 4) all over their ranges."""
    r = rng(seed)
    state = r.random(count), r.integers(-1, 2, count)
    return np.column_stack([*state, r.uniform(0, 2, count), r.uniform(-90, 90, count)])


def law(inputs):
    """A state Δ later (n, 2) that follows from state and control, linear in the area."""
    area = 0.1 + 0.5 * inputs[:, 0] + 0.15 * inputs[:, 2]
    return np.column_stack([area, np.where(np.abs(inputs[:, 3]) < 30, 0, np.sign(inputs[:, 3]))])


def random_model(seed=0, hidden=20):
    r = rng(seed)
    return MotionModel(
        0.2, MARGIN, *find_input_range(random_inputs(50, seed)), np.array([0.0, -1.0]),
        np.array([1.0, 1.0]), r.normal(size=(4, hidden)), r.normal(size=hidden), r.normal(size=(hidden, 2)),
        r.normal(size=2),
    )  # fmt: skip


def learnt(inputs, outputs, how=HOW, seed=0):
    return train_motion_model(inputs, outputs, (inputs[:40], outputs[:40]), how, 0.2, rng(seed))


def table(lengths, starts=None, delta=DELTA, seed=0):
    """A feature table of tracks of these lengths: a fish that turns for a while now and then."""
    parts, r = [], rng(seed)
    starts = starts or [0] * len(lengths)
    for number, (length, start) in enumerate(zip(lengths, starts, strict=True)):
        kind = np.repeat(r.integers(-1, 2, length // 7 + 1), 7)[:length]
        area = np.clip(0.1 + 0.6 * np.abs(kind) + 0.05 * r.normal(size=length), 0, 1)
        gone = np.arange(length) >= length - delta
        frame = start + np.arange(length)
        far = r.uniform(20, 90, length)
        shift = np.r_[kind[delta:], kind[:delta]]
        parts.append(
            pd.DataFrame(0.0, index=range(length), columns=FEATURES.names).assign(
                track_id=number, frame=frame, time_s=frame / 25, orientation=1,
                body_length_px=60.0, head_confidence=1.0, motion_area_rel=area, swimming_type=kind,
                displacement=np.where(gone, np.nan, 0.4 + 0.05 * r.normal(size=length)),
                included_angle_deg=np.where(gone, np.nan, shift * far + 8 * r.normal(size=length)),
            )
        )  # fmt: skip
    return pd.concat(parts, ignore_index=True)


# -- rows -------------------------------------------------------------------------------------------


def test_a_row_is_the_state_and_control_now_and_the_state_delta_later():
    features = table([12, 9], starts=[3, 40])
    rows = pair_rows_with_later(features, DELTA)
    assert len(rows.frame) == (12 - DELTA) + (9 - DELTA)
    at = features.set_index(["track_id", "frame"])
    columns = rows.track_id, rows.frame, rows.inputs, rows.outputs
    for track, frame, given, wanted in zip(*columns, strict=True):
        assert np.array_equal(given, at.loc[(track, frame), list(INPUTS)])
        assert np.array_equal(wanted, at.loc[(track, frame + DELTA), list(OUTPUTS)])
    mixed = pair_rows_with_later(features.sample(frac=1, random_state=0), DELTA)
    assert np.array_equal(rows.inputs, mixed.inputs) and np.array_equal(rows.frame, mixed.frame)


def test_a_row_needs_everything_on_both_ends():
    features = table([30])
    features.loc[4, "displacement"] = np.nan
    features.loc[11, "included_angle_deg"] = np.nan
    # No frame 20: neither now nor later.
    rows = pair_rows_with_later(features.drop(index=20), DELTA)
    assert sorted(rows.frame) == sorted(set(range(25)) - {4, 11, 20, 15})
    assert len(pair_rows_with_later(table([DELTA, 3]), DELTA).frame) == 0
    longer = pair_rows_with_later(table([40], delta=8), DELTA)
    assert len(longer.frame) == 32  # Δ of the table, if that is longer


# -- splits -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("block", [8, 25, 60])
def test_no_window_reaches_from_one_side_into_the_other(seed, block):
    rows = pair_rows_with_later(table([200, 120, 90], starts=[0, 30, 110]), DELTA)
    train_side, held = split_by_blocks(rows, block, 0.3, rng(seed))
    assert not np.any(train_side & held)

    def frames(side):
        """Every frame that a row of this side sees, from its input to its output."""
        return {f for start in rows.frame[side] for f in range(start, start + DELTA + 1)}

    assert frames(train_side).isdisjoint(frames(held))
    blocks = [{f // block for f in frames(side)} for side in (train_side, held)]
    assert blocks[0].isdisjoint(blocks[1])
    lost = ~train_side & ~held  # and only rows at such a border are left out
    assert np.all(rows.frame[lost] // block != (rows.frame[lost] + DELTA) // block)


def test_tracks_are_split_whole():
    rows = pair_rows_with_later(table([60, 50, 40, 70, 30]), DELTA)
    train_side, held = split_by_tracks(rows, 0.3, rng())
    assert np.array_equal(train_side, ~held)
    assert set(rows.track_id[train_side]).isdisjoint(rows.track_id[held])


@pytest.mark.parametrize("share", [0.05, 0.2, 0.5, 0.9])
def test_the_share_held_out_is_as_asked(share):
    rows = pair_rows_with_later(table([3000, 2000]), DELTA)
    train_side, held = split_by_blocks(rows, 50, share, rng())
    assert held.sum() / (held.sum() + train_side.sum()) == pytest.approx(share, abs=0.02)
    many = pair_rows_with_later(table([50] * 60), DELTA)
    assert split_by_tracks(many, share, rng())[1].mean() == pytest.approx(share, abs=0.02)


@pytest.mark.parametrize("share", [0.001, 0.999])
def test_neither_side_is_ever_empty(share):
    rows = pair_rows_with_later(table([60, 60]), DELTA)
    for side in (*split_by_tracks(rows, share, rng()), *split_by_blocks(rows, 30, share, rng())):
        assert side.sum() >= 20


@pytest.mark.parametrize(
    ("lengths", "split", "message"),
    [
        ([200], lambda r: split_by_tracks(r, 0.2, rng()), r"1 track(.|\n)*bpn.held_out_by=blocks"),
        ([200], lambda r: split_by_blocks(r, 500, 0.2, rng()), r"1 block(.|\n)*bpn.held_out_block"),
        ([3], lambda r: split_by_blocks(r, 500, 0.2, rng()), r"0 block(.|\n)*longer film"),
        ([3], lambda r: split_by_tracks(r, 0.2, rng()), "0 track"),
        ([20, 6], lambda r: split_by_tracks(r, 0.2, rng()), r"15 rows to learn from and 1 held out"),
        ([20], lambda r: split_by_blocks(r, 10, 0.2, rng()), r"rows to learn(.|\n)*at least 20"),
        ([400], lambda r: split_by_blocks(r, 1, 0.5, rng()), r"1 frames(.|\n)*at least as long as Δ"),
    ],
)  # fmt: skip
def test_too_little_to_learn_from_is_said(lengths, split, message):
    with pytest.raises(FinloopError, match=message):
        split(pair_rows_with_later(table(lengths), DELTA))


# -- scaling ----------------------------------------------------------------------------------------


def test_the_scaled_range_ignores_wild_frames():
    inputs = random_inputs(1000)
    low, high = find_input_range(inputs)
    wild = inputs.copy()
    wild[::500, 2:] = [50, 179]
    for one, two in zip((low, high), find_input_range(wild), strict=True):
        assert two == pytest.approx(one, rel=0.05, abs=0.05)
    scaled = scale_to_unit(wild, low, high)
    assert np.abs(scaled).max() == 1
    assert low[3] == -high[3]  # no turn stays in the middle
    assert scale_to_unit(np.array([[0.5, 0, 1, 0]]), low, high)[0, [0, 1, 3]] == pytest.approx(0)


@pytest.mark.parametrize("columns", [[0], [1], [2], [3], [0, 1, 2, 3]])
def test_a_constant_input_is_no_division_by_zero(columns):
    inputs = random_inputs(60)
    inputs[:, columns] = 0
    model, curve = learnt(inputs, law(inputs))
    assert np.isfinite(model.predict(inputs)).all()
    if len(columns) == 4:  # nothing changes: that is learnt
        assert model.predict(inputs[:1]) == pytest.approx(law(inputs[:1]), abs=0.01)
    assert np.isfinite(curve.to_numpy()).all()
    assert np.all(model.input_low < model.input_high)


# -- the network ------------------------------------------------------------------------------------


def problem(rows=7, hidden=6, seed=3):
    r = rng(seed)
    x = np.column_stack([r.uniform(-1, 1, (rows, 4)), np.ones(rows)])
    return draw_first_weights(hidden, r), x, r.uniform(0.05, 0.95, (rows, 2))


def network(weights, x):
    """Fig. 6 by torch: x (n, 5) → o (n, 2)."""
    first, second = split_layers(weights)
    h = torch.sigmoid(x @ first.T)
    return torch.sigmoid(torch.cat([h, torch.ones_like(h[:, :1])], 1) @ second.T)


def energy(weights, x, t):
    return 0.5 * (network(weights, x) - t).square().sum()


@pytest.mark.parametrize("size", [0, 1, 40, 1e4, 1e300])
def test_a_unit_gives_the_sigmoid_of_its_sum_however_large(size):
    weights, signals = size * np.array([1.0, -2.0, 0.5]), np.array([0.5, -0.25, 1.0])
    for sign in (1, -1):
        wanted = scipy.special.expit(sign * weights @ signals)
        assert unit_output(sign * weights, signals) == pytest.approx(wanted, rel=1e-12)


def test_a_step_reckoned_on_paper():
    """A network 4-1-2 with h = sigmoid(ln 3) = 3/4 and both o = sigmoid(0) = 1/2."""
    weights, velocity = np.zeros(9), np.zeros(9)
    first, second = split_layers(weights)
    first[0, 0], second[0] = np.log(3), [2, -1.5]
    before = weights.copy()
    x, t = np.array([[1.0, 0, 0, 0, 1]]), np.array([[0.1, 0.5]])
    learn_epoch(x, t, weights, velocity, 0.5, 0.5)
    # (o - t) o (1 - o) = 0.1, half of it is the step; times h; behind it times 2 h (1 - h)
    wanted = -np.array([0.01875, 0, 0, 0, 0.01875, 0.0375, 0.05, 0, 0])
    assert weights - before == pytest.approx(wanted, abs=1e-12)
    assert velocity == pytest.approx(wanted, abs=1e-12)


def test_an_epoch_is_that_of_sgd_with_momentum():
    weights, x, t = problem(rows=50)
    leaf = torch.from_numpy(weights.copy()).requires_grad_()
    peer = torch.optim.SGD([leaf], lr=0.1, momentum=0.5)
    velocity = np.zeros_like(weights)
    for _ in range(3):
        for row_x, row_t in zip(torch.from_numpy(x), torch.from_numpy(t), strict=True):
            peer.zero_grad()
            energy(leaf, row_x[None], row_t).backward()
            peer.step()
        learn_epoch(x, t, weights, velocity, 0.1, 0.5)
    np.testing.assert_allclose(weights, leaf.detach().numpy(), rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("hidden", [1, 6])
def test_the_model_says_what_the_network_says(hidden):
    weights, x, _ = problem(hidden=hidden)
    model = model_from_weights(weights, -np.ones(4), np.ones(4), 0.2)
    o = network(torch.from_numpy(weights), torch.from_numpy(x)).numpy()
    share = np.clip((o - MARGIN) / (1 - 2 * MARGIN), 0, 1)
    assert model.predict(x[:, :4]) == pytest.approx(share * [1, 2] - [0, 1], abs=1e-12)


def test_first_weights_are_within_their_reach_and_biases_0():
    first, second = split_layers(draw_first_weights(400, rng()))
    for layer, before, after in ((first, 4, 400), (second, 400, 2)):
        assert layer.shape == (after, before + 1)
        assert not layer[:, -1].any()
        reach = np.sqrt(6 / (before + after))
        assert 0.98 * reach < np.abs(layer[:, :-1]).max() <= reach


@pytest.mark.parametrize("hidden", [1, 3, 20])
def test_the_model_is_the_network_that_was_learnt(hidden):
    inputs, held = random_inputs(61), random_inputs(30, 1)

    def step_law(inputs):  # the sigmoids overshoot the ends of the range, and are clipped
        return np.column_stack([inputs[:, 0] > 0.5, np.sign(inputs[:, 3])]).astype(float)

    how = replace(HOW, hidden_units=hidden, epochs=60)
    model, curve = train_motion_model(
        inputs, step_law(inputs), (held, step_law(held)), how, 0.2, rng()
    )  # fmt: skip
    assert len(model.hidden_bias) == hidden
    assert model.delta_s == 0.2
    for side, given in (("train", inputs), ("held_out", held)):
        found = state_errors(model.predict(given), step_law(given))
        for name in ("area_rmse", "type_rmse", "type_error_pct"):
            assert curve[f"{side}_{name}"].iloc[-1] == pytest.approx(found[name], rel=1e-9)
    assert curve["epoch"].tolist() == list(range(61))


def test_it_learns_a_law():
    inputs, unseen = random_inputs(1500), random_inputs(300, 1)
    model, curve = learnt(inputs, law(inputs), replace(HOW, epochs=100))
    found = state_errors(model.predict(unseen), law(unseen))
    assert found["area_rmse"] < 0.02
    assert found["type_accuracy_pct"] > 93
    assert min(found[f"{word}_recall_pct"] for word in ("straight", "left", "right")) > 90
    assert curve["train_area_rmse"].iloc[-1] < curve["train_area_rmse"].iloc[0] / 10


def test_states_stay_in_their_range_whatever_goes_in():
    for seed in range(5):
        model = random_model(seed)
        model = replace(model, output_weights=20 * model.output_weights)
        far = rng(seed).normal(0, 1e6, (200, 4))
        found = model.predict(far)
        assert found.min(0).tolist() >= [0, -1]
        assert found.max(0).tolist() <= [1, 1]
        assert set(round_swimming_types(found[:, 1])) <= {-1, 0, 1}


def same(one, two):
    names = [field.name for field in fields(one)]
    return all(np.array_equal(getattr(one, name), getattr(two, name)) for name in names)


def test_the_seed_decides_every_bit():
    inputs = random_inputs(100)
    how = replace(HOW, epochs=3)
    one, two = (learnt(inputs, law(inputs), how) for _ in range(2))
    assert same(one[0], two[0])
    pd.testing.assert_frame_equal(one[1], two[1], check_exact=True)
    assert not same(one[0], learnt(inputs, law(inputs), how, seed=1)[0])


def test_every_row_is_learnt_from_once_an_epoch(monkeypatch):
    seen = []
    real = finloop.bpn.back_propagation.learn_epoch

    def record_rows(x, *given):
        seen.extend(x[:, 0].tolist())
        real(x, *given)

    monkeypatch.setattr(finloop.bpn.back_propagation, "learn_epoch", record_rows)
    inputs = random_inputs(101)
    how = replace(HOW, epochs=2, learning_rate=0.01)
    learnt(inputs, law(inputs), how)
    low, high = find_input_range(inputs)
    wanted = np.sort(scale_to_unit(inputs, low, high)[:, 0])
    assert np.sort(seen[:101]) == pytest.approx(wanted)
    assert np.sort(seen[101:]) == pytest.approx(wanted)
    assert seen[:101] != seen[101:]


def test_weights_that_run_away_are_said():
    inputs = random_inputs(60)
    with pytest.raises(FinloopError, match=r"without bound(.|\n)*bpn.learning_rate"):
        learnt(inputs, law(inputs), replace(HOW, learning_rate=1e308, epochs=3))


# -- errors and baselines ---------------------------------------------------------------------------


def test_errors_counted_by_hand():
    true = np.array([[0.0, 0], [0.2, 0], [0.4, 1], [0.6, 1], [0.8, -1]])
    said = np.array([[0.0, 0.4], [0.2, -0.9], [0.4, 0.6], [0.6, 0.2], [0.3, -1]])
    found = state_errors(said, true)
    assert found["area_rmse"] == pytest.approx(np.sqrt(0.25 / 5))
    assert found["type_rmse"] == pytest.approx(np.sqrt((0.16 + 0.81 + 0.16 + 0.64) / 5))
    assert found["type_accuracy_pct"] == pytest.approx(60)
    assert found["type_error_pct"] == pytest.approx(40)
    recalls = [found[f"{word}_recall_pct"] for word in ("straight", "left", "right")]
    assert recalls == pytest.approx([50, 50, 100])
    assert count_confusions(said, true).tolist() == [[1, 0, 1], [1, 1, 0], [0, 0, 1]]
    found = state_errors(np.zeros((4, 2)), np.zeros((4, 2)))
    assert found["straight_recall_pct"] == 100
    assert np.isnan(found["left_recall_pct"])  # this type does not occur


def test_the_baselines():
    inputs = random_inputs(80)
    slopes = np.array([[0.3, 0], [0, 0.5], [0.1, 0.1], [0.001, 0.002]])
    later = inputs @ slopes + [0.2, -0.1]
    unseen = random_inputs(20, 1)
    wanted = unseen @ slopes + [0.2, -0.1]
    assert predict_by_linear_fit(inputs, later, unseen) == pytest.approx(wanted)
    # Nothing beyond the range.
    assert predict_by_linear_fit(inputs, 9 * later, unseen)[:, 0].max() == 1


def test_skill_is_one_minus_the_share_of_the_error():
    rows = pair_rows_with_later(table([900, 600]), DELTA)
    sides = split_by_blocks(rows, 50, 0.3, rng())
    found = assess_model(random_model(), rows, *sides)
    for baseline in ("persistence", "linear"):
        share = found["held_out_area_rmse"] / found[f"{baseline}_area_rmse"]
        assert found[f"area_rmse_skill_against_{baseline}"] == pytest.approx(1 - share)
        wrong = (100 - found["held_out_type_accuracy_pct"]) / (
            100 - found[f"{baseline}_type_accuracy_pct"]
        )
        assert found[f"type_error_skill_against_{baseline}"] == pytest.approx(1 - wrong)
    worse = [v for k, v in found.items() if "_skill_" in k and v <= 0]
    assert found["skills_not_above_0"] == len(worse) > 0  # an untaught network
    known = rows.inputs[sides[0]], rows.outputs[sides[0]]
    model, _ = learnt(*known, replace(HOW, epochs=100))
    taught = assess_model(model, rows, *sides)
    assert taught["skills_not_above_0"] == 0
    assert (taught["train_rows"], taught["held_out_rows"]) == tuple(side.sum() for side in sides)
    assert taught["persistence_area_rmse"] == found["persistence_area_rmse"]
    still = pair_rows_with_later(table([200]).assign(swimming_type=0, motion_area_rel=0.3), DELTA)
    found = assess_model(random_model(), still, *split_by_blocks(still, 40, 0.3, rng()))
    assert found["persistence_area_rmse"] == 0
    assert np.isnan(found["type_error_skill_against_persistence"])  # no error to compare with


# -- pictures ---------------------------------------------------------------------------------------


def test_figure_15_shows_both_curves(tmp_path):
    inputs = random_inputs(60)
    _, curve = learnt(inputs, law(inputs), replace(HOW, epochs=4))
    figure = figure15(curve)
    for axes, name in zip(figure.axes, ("area_rmse", "type_error_pct"), strict=True):
        drawn = [line.get_ydata().tolist() for line in axes.lines]
        assert drawn == [curve[f"{side}_{name}"].tolist() for side in ("train", "held_out")]
        assert curve[f"held_out_{name}"].iloc[1:].max() <= axes.get_ylim()[1]
    save_figure(tmp_path / "a.png", figure)
    assert load_picture(tmp_path / "a.png").std() > 5


@pytest.mark.parametrize("count", [1, 300])
def test_the_figure_of_held_out_rows(tmp_path, count):
    inputs = random_inputs(count)
    true, said = law(inputs), random_model().predict(inputs)
    figure = draw_held_out_predictions(said, true)
    left, right = figure.axes
    drawn = np.asarray(left.collections[-1].get_offsets())  # before it, those of the legend
    assert drawn == pytest.approx(np.column_stack([true[:, 0], said[:, 0]]))
    for (row, column), number in np.ndenumerate(count_confusions(said, true)):
        (cell,) = [text for text in right.texts if text.get_position() == (column, row)]
        assert f"({number})" in cell.get_text()
    save_figure(tmp_path / "a.png", figure)
    assert load_picture(tmp_path / "a.png").std() > 5


# -- files ------------------------------------------------------------------------------------------


def test_a_model_comes_back_to_the_bit(tmp_path):
    path = tmp_path / "model.json"
    for seed in range(5):
        model = replace(random_model(seed, hidden=seed + 1), delta_s=6 / 28.07)
        save_json(path, model.to_values(), indent=1)
        assert same(load_record(path, restore_motion_model, "bpn"), model)
    assert list(tmp_path.iterdir()) == [path]
    held = json.loads(path.read_text())
    assert held["inputs"] == INPUTS
    assert held["outputs"] == OUTPUTS


HARM = {
    "no JSON": lambda text: text[: len(text) // 2],
    "no object": lambda text: "[]",
    "another format": lambda text: text.replace("motion model 1", "motion model 2"),
    "another unit": lambda text: text.replace("body length", "px"),
    "a NaN": lambda text: text.replace('"margin": 0.05', '"margin": NaN'),
    "an endless weight": lambda text: re.sub(r'(?<="hidden_bias": \[\n)[^,]*', "1e999", text),
    "a word": lambda text: text.replace('"margin": 0.05', '"margin": "a"'),
    "no delta": lambda text: text.replace('"delta_s"', '"delta"'),
    "a negative delta": lambda text: text.replace('"delta_s": 0.2', '"delta_s": -0.2'),
    "a range upside down": lambda text: text.replace("[\n  0.0,\n  -1.0\n ]", "[\n  2.0,\n  -1.0\n ]"),
    "a weight too few": lambda text: text.replace('"output_bias": [', '"output_bias": [1.0,'),
}  # fmt: skip


@pytest.mark.parametrize("harm", HARM)
def test_a_damaged_model_is_one_message(tmp_path, harm):
    path = tmp_path / "model.json"
    save_json(path, random_model().to_values(), indent=1)
    whole = path.read_text()
    damaged = HARM[harm](whole)
    assert damaged != whole
    path.write_text(damaged)
    for _ in range(2):
        with pytest.raises(FinloopError, match=r"model.json cannot be read(.|\n)*bpn"):
            load_record(path, restore_motion_model, "bpn")
        path.unlink(missing_ok=True)


def test_onnx_gives_the_numbers_of_the_model(tmp_path):
    model = random_model()
    path = tmp_path / "model.onnx"
    path.write_bytes(export_onnx_bytes(model))
    session = onnxruntime.InferenceSession(path.read_bytes(), providers=["CPUExecutionProvider"])
    inputs = np.vstack([random_inputs(300), rng().normal(0, 500, (50, 4))])
    (found,) = session.run([OUTPUT_NAME], {INPUT_NAME: inputs.astype(np.float32)})
    assert found == pytest.approx(model.predict(inputs), abs=1e-5)
    assert session.run(None, {INPUT_NAME: inputs[:1].astype(np.float32)})[0].shape == (1, 2)
    facts = session.get_modelmeta().custom_metadata_map
    assert float(facts["delta_s"]) == model.delta_s
    assert "included_angle_deg [deg]" in facts["inputs"]
    once = path.read_bytes()
    assert export_onnx_bytes(model) == once


def test_an_export_that_says_something_else_is_refused(monkeypatch):
    other = build_onnx_model(replace(random_model(), output_bias=np.array([0.0, 0.01])))
    assert largest_output_difference(other, random_model()) > 1e-3
    monkeypatch.setattr(finloop.bpn.onnx, "build_onnx_model", lambda model: other)
    with pytest.raises(FinloopError, match=r"the exported network \(ONNX\) is off by"):
        export_onnx_bytes(random_model())
    onnx.checker.check_model(other)  # a sound graph, only the wrong one


# -- the stage --------------------------------------------------------------------------------------

MADE = {"curve.csv", "metrics.json"}
SHORT = ("bpn.epochs=4", "bpn.held_out_block_deltas=4")


def put(folder, features, *overrides):
    """A folder in which `features` has run on a film at 25 Hz."""
    prepare(folder, *SHORT, *overrides)
    facts = VideoFacts("file", 320, 240, 500, Fraction(25), False, ((0, 500),))
    (folder / "data/clip").mkdir(parents=True, exist_ok=True)
    save_facts(folder / "data/clip" / FACTS_NAME, facts)
    save_table(folder / "data/features/features.parquet", features, FEATURES)


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ran")
    put(folder, table([150, 90, 60]))
    with chdir(folder):
        stages.bpn.main()
        stages.plots.bpn.main()
    return folder


workspace = copy_of("ran", "no_drawing")


def metrics(folder):
    return load_numbers(folder / "reports/bpn")


def test_the_stage_makes_the_model_and_its_reports_the_same_each_time(workspace):
    assert set(content(workspace / "reports/bpn")) == MADE
    assert set(content(workspace / "reports/motion/bpn")) == {"fig15.png", "held_out.png"}
    assert set(content(workspace / "data/bpn")) == {"held_out.parquet", "model.json", "model.onnx"}
    model = load_record(workspace / "data/bpn/model.json", restore_motion_model, "bpn")
    assert model.delta_s == pytest.approx(DELTA / 25)
    assert len(model.hidden_bias) == 20
    curve = pd.read_csv(workspace / "reports/bpn/curve.csv")
    assert curve["epoch"].tolist() == list(range(5))
    found = metrics(workspace)
    assert curve["held_out_area_rmse"].iloc[-1] == pytest.approx(
        found["held_out_area_rmse"], abs=1e-5
    )
    assert "other_split_held_out_area_rmse" in found
    assert all(isinstance(number, int | float) for number in found.values())
    once = content(workspace / "data/bpn") | content(workspace / "reports")
    shutil.rmtree(workspace / "data/bpn")
    shutil.rmtree(workspace / "reports")
    stages.bpn.main()
    stages.plots.bpn.main()
    assert same_but_figures(once, content(workspace / "data/bpn") | content(workspace / "reports"))


@pytest.mark.parametrize(
    "override", ["bpn.seed=1", "bpn.held_out_by=tracks", "bpn.hidden_units=5",
                 "bpn.momentum=0", "bpn.learning_rate=0.2", "bpn.held_out_ratio=0.4"]
)  # fmt: skip
def test_every_parameter_changes_the_model(workspace, override):
    once = content(workspace / "data/bpn")
    prepare(workspace, *SHORT, override)
    stages.bpn.main()
    assert content(workspace / "data/bpn") != once


def test_the_seed_decides_the_split_and_the_first_weights(workspace):
    models = []
    for seed in (0, 1):
        prepare(workspace, *SHORT, "bpn.learning_rate=1e-9", f"bpn.seed={seed}")
        stages.bpn.main()
        models.append(load_record(workspace / "data/bpn/model.json", restore_motion_model, "bpn"))
    one, two = models
    assert one.input_high[3] != two.input_high[3]  # from other rows
    assert np.abs(one.hidden_weights - two.hidden_weights).max() > 0.1


def test_the_metrics_of_either_split_and_those_that_a_film_cannot_have(workspace):
    by_blocks = metrics(workspace)
    prepare(workspace, *SHORT, "bpn.held_out_by=tracks")
    stages.bpn.main()
    by_tracks = metrics(workspace)
    for name in ("held_out_area_rmse", "type_rmse_skill_against_linear"):
        assert by_tracks[name] == by_blocks[f"other_split_{name}"]
        assert by_tracks[f"other_split_{name}"] == by_blocks[name]
    put(workspace, table([200]).assign(swimming_type=0), "bpn.held_out_block_deltas=5000")
    stages.bpn.main()
    found = metrics(workspace)  # of one track, without turns, shorter than its blocks
    assert not [name for name in found if name.startswith("other_split")]
    assert found["held_out_straight_recall_pct"] == 100
    assert "held_out_left_recall_pct" not in found
    assert 0.1 < found["held_out_rows"] / 200 < 0.3


@pytest.mark.parametrize(
    ("lengths", "overrides", "message"),
    [
        ([200], ["bpn.held_out_by=tracks"], "1 track"),
        ([200], ["bpn.learning_rate=1e308"], "without bound"),
    ],
)
def test_bad_input_is_one_message_and_leaves_what_was_there(workspace, lengths, overrides, message):
    before = content(workspace / "data/bpn") | content(workspace / "reports")
    put(workspace, table(lengths), *overrides)
    with pytest.raises(FinloopError, match=message):
        stages.bpn.main()
    assert content(workspace / "data/bpn") | content(workspace / "reports") == before


@pytest.mark.parametrize("length", [16, 30])
def test_a_short_film_is_learnt_whole_and_no_error_is_called_held_out(workspace, length, capsys):
    put(workspace, table([length]))
    stages.bpn.main()
    found = metrics(workspace)
    assert found["train_rows"] == length - DELTA
    assert found["held_out_rows"] == 0
    assert not [name for name in found if name.startswith(("held_out_area", "area_rmse_skill"))]
    assert "skills_not_above_0" not in found  # none is known to be above
    assert "none is held out" in capsys.readouterr().err


@pytest.mark.parametrize("by", ["blocks", "tracks"])
def test_of_a_long_film_so_many_rows_are_learnt_from(by):
    rows = pair_rows_with_later(table([300, 200, 150, 120, 90]), DELTA)
    every, held = split_rows(rows, by, settings("bpn"))
    most = int(every.sum()) // 2
    some, same = split_rows(rows, by, with_constants(settings("bpn"), most_rows=most))
    np.testing.assert_array_equal(held, same)
    assert some.sum() == most and not (some & ~every).any()
    assert len(np.unique(rows.frame[some] // 20)) > 0.9 * len(np.unique(rows.frame[every] // 20))
