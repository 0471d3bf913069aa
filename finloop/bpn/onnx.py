"""The motion model as ONNX, for other programs: physical units go in and come out.

The scaling is part of the graph. It has 32-bit numbers, which every runtime takes. Another
evaluator, ONNX's own, runs the finished graph before the file appears.
"""

from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper
from onnx.reference import ReferenceEvaluator

from finloop.base.errors import FinloopError
from finloop.bpn.model import INPUTS, OUTPUTS, MotionModel

INPUT_NAME, OUTPUT_NAME = "state_and_control", "next_state"
_OPSET, _IR_VERSION = 17, 8  # of 2022: today's runtimes read them
_TOLERANCE = 1e-4  # share of the range of an output; 32-bit rounding gives about a hundredth of it


def build_onnx_model(model: MotionModel) -> onnx.ModelProto:
    """Return `MotionModel.predict` as an ONNX graph: float32 (n, 4) → (n, 2), physical units."""
    # As `predict` computes: (x − low) / (high − low) · 2 − 1 = (x − middle) / half_range, and
    # low + (raw − margin) / (1 − 2 margin) · range = raw · span + offset.
    half_range = (model.input_high - model.input_low) / 2
    span = (model.output_high - model.output_low) / (1 - 2 * model.margin)
    constants = {
        "input_low": model.input_low,
        "input_high": model.input_high,
        "input_middle": (model.input_low + model.input_high) / 2,
        "input_scale": 1 / half_range,
        "hidden_weights": model.hidden_weights,
        "hidden_bias": model.hidden_bias,
        "output_weights": model.output_weights,
        "output_bias": model.output_bias,
        "output_span": span,
        "output_offset": model.output_low - model.margin * span,
        "output_low": model.output_low,
        "output_high": model.output_high,
    }
    # What is done to the inputs, step by step: an operator, and the constants that it takes.
    chain = [
        ("Max", ["input_low"]), ("Min", ["input_high"]),
        ("Sub", ["input_middle"]), ("Mul", ["input_scale"]),
        ("Gemm", ["hidden_weights", "hidden_bias"]), ("Sigmoid", []),
        ("Gemm", ["output_weights", "output_bias"]), ("Sigmoid", []),
        ("Mul", ["output_span"]), ("Add", ["output_offset"]),
        ("Max", ["output_low"]), ("Min", ["output_high"]),
    ]  # fmt: skip
    # Each operator reads the name before it, and writes the name after it.
    names = [INPUT_NAME, *(f"step_{number}" for number in range(1, len(chain))), OUTPUT_NAME]
    nodes = [
        helper.make_node(kind, [names[number], *constant_names], [names[number + 1]])
        for number, (kind, constant_names) in enumerate(chain)
    ]
    graph = helper.make_graph(
        nodes,
        "fish_motion",
        [helper.make_tensor_value_info(INPUT_NAME, TensorProto.FLOAT, ["rows", len(INPUTS)])],
        [helper.make_tensor_value_info(OUTPUT_NAME, TensorProto.FLOAT, ["rows", len(OUTPUTS)])],
        [numpy_helper.from_array(v.astype(np.float32), name) for name, v in constants.items()],
    )
    proto = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", _OPSET)], producer_name="finloop"
    )
    proto.ir_version = _IR_VERSION
    facts = {
        "inputs": ", ".join(f"{name} [{unit}]" for name, unit in INPUTS.items()),
        "outputs": ", ".join(f"{name} [{unit}]" for name, unit in OUTPUTS.items()),
        "delta_s": repr(float(model.delta_s)),
    }
    helper.set_model_props(proto, facts)
    return proto


def export_onnx_bytes(model: MotionModel) -> bytes:
    """Return a model as the bytes of an ONNX file, checked against the model.

    FinloopError if their outputs differ by more than 1e-4 of their range.
    """
    proto = build_onnx_model(model)
    onnx.checker.check_model(proto, full_check=True)
    difference = largest_output_difference(proto, model)
    if not difference <= _TOLERANCE:
        raise FinloopError(
            f"the exported network (ONNX) is off by {difference:g} of the range of an output",
            f"a difference from the trained network of at most {_TOLERANCE:g}",
            "train with a smaller bpn.learning_rate: 32 bits cannot represent weights this large",
        )
    return proto.SerializeToString(deterministic=True)


def largest_output_difference(graph: onnx.ModelProto, model: MotionModel) -> float:
    """Return the largest difference between an ONNX graph's outputs and the model's, 0 … 1.

    It is relative to the outputs' range. Both predict from 1000 points spread over the input range
    and a tenth beyond it, and from a grid that reaches as far beyond as the range is wide.
    """
    low, high = model.input_low, model.input_high
    shares = np.random.default_rng(0).uniform(-0.1, 1.1, (1000, len(low)))
    grid = np.stack(np.meshgrid(*([[-1.0, 0.0, 0.5, 1.0, 2.0]] * len(low))), -1)
    points = low + np.vstack([shares, grid.reshape(-1, len(low))]) * (high - low)
    inputs = points.astype(np.float32)
    answers: Any = ReferenceEvaluator(graph).run(None, {INPUT_NAME: inputs})
    span = model.output_high - model.output_low
    return float(np.abs((answers[0] - model.predict(points)) / span).max())
