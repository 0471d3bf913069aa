"""Stage `forecast`: learn to predict the next pose and motion, and the film's spread around it."""

from stages.run import report_progress, run, save_metrics  # isort: skip  (before numpy)

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pandas as pd

from finloop.base.errors import FinloopError
from finloop.forecast import assess
from finloop.forecast.film import MOTION, FilmStates, Partition, split_held_out
from finloop.forecast.model import Forecast
from finloop.forecast.neighbours import build_similarity_graph
from finloop.forecast.sampling import Sampler, build_sampler, swim_freely
from finloop.forecast.settings import ForecastSettings
from finloop.io.atomic import whole_folder
from finloop.io.mapped import open_array, save_array
from finloop.io.record import load_record, save_json
from finloop.io.table import save_csv, save_table
from finloop.jumps.table import VisibleFacts
from finloop.jumps.visible import VisibleDistance
from finloop.project import Project
from stages.settings import load_settings

OUT, REPORT = Path("data/forecast"), Path("reports/forecast")
FREE_TICKS = 20_000  # most ticks of the fish that only the forecast moves
CURVE = ["epoch", "train_error", "held_out_error"]


def _load_visible_distance(project: Project) -> VisibleDistance:
    """Return the object that measures how different two rows of the film look.

    Its pictures are memory-mapped from the stage `jumps`.
    """
    folder, poses = project.data / "jumps", project.poses
    natural = load_record(folder / "facts.json", VisibleFacts, "jumps").natural
    pictures = open_array(folder / "pictures.npy", (len(poses.codes), None, None, None), "uint8")
    return VisibleDistance(pictures, poses.pose.posture, natural)


def _area_errors(project: Project, model: Forecast, parts: Partition) -> dict[str, float]:
    """Return the RMS errors, by name, of motion areas predicted for Δ later on held-out rows.

    Key area_rmse: error of the model; persistence_area_rmse: error of the prediction that nothing
    changes. Both are shares of the film's largest motion area. Δ is the time over which motion is
    measured. Held-out rows count only if they and the rows after them, Δ in all, are usable
    (`FilmStates`). The result is {} if there are none.
    """
    features, poses, film = project.features, project.poses, project.forecast_states
    rows = parts.held_out[parts.held_out < film.count]  # the later ones are mirror images
    rows = rows[film.usable[rows[:, None] + np.arange(film.delta)].all(axis=1)]
    if not len(rows):
        return {}
    states, codes = assess.roll_out_means(film, model, rows), poses.codes[rows].copy()
    # A state is the first pose codes, then the motion; further codes stay those of the row.
    codes[:, : states.shape[1] - MOTION] = states[:, :-MOTION]
    areas = assess.posture_bends(poses.shapes.decode(codes))
    true = features["motion_area_rel"].to_numpy(float)
    predictions = {"": areas / features["motion_area"].max(), "persistence_": true[rows]}
    return {
        f"{name}area_rmse": float(np.sqrt(np.mean((predicted - true[rows + film.delta]) ** 2)))
        for name, predicted in predictions.items()
    }


def _measure_forecast(
    film: FilmStates, sampler: Sampler, parts: Partition, rng: np.random.Generator, folder: Path
) -> dict[str, float]:
    """Return measures of the forecast by name: on held-out rows, and in a freely predicted fish.

    sampler: draws predictions. parts: which rows are held out. The tables held_out.parquet and
    free.parquet are written to `folder`. Return numbers by name.
    """
    ensemble = assess.predict_ensembles(film, sampler, parts, rng)
    states, rows = swim_freely(sampler, min(film.count, FREE_TICKS), rng)
    save_table(folder / "held_out.parquet", assess.rank_table(ensemble), assess.HELD_OUT)
    save_table(folder / "free.parquet", assess.free_swim_table(states, rows), assess.FREE)
    return {
        **assess.measure_predictions(film, ensemble, sampler, parts),
        **assess.compare_free_swim(states, rows, film, sampler),
        **assess.measure_control_slopes(sampler, film, rng),
    }


def _save_reason(folder: Path, error: FinloopError) -> None:
    """Print and store why there is no model; write empty files for the report."""
    print(f"forecast: no model, so mode matching predicts nothing: {error}", file=sys.stderr)
    save_json(folder / "reason.json", {"reason": str(error)})
    save_csv(REPORT / "curve.csv", pd.DataFrame(columns=CURVE), decimals=4)
    save_metrics(REPORT / "metrics.json", {"models": 0})


def main() -> None:
    """Train the network that predicts pose and motion; write data/forecast/ and reports/forecast/.

    Where the film shows too little there is no model, and data/forecast/ has only reason.json.
    """
    p: ForecastSettings = load_settings("forecast")
    project = Project()
    with whole_folder(OUT) as folder:
        try:
            film = project.forecast_states
            parts = split_held_out(film, p)
            with (  # the graph of similar rows takes half of the time: in parallel
                ThreadPoolExecutor(1) as executor,
                report_progress("forecast", p.epochs, "epochs") as advance,
            ):
                visible = _load_visible_distance(project)
                graph_job = executor.submit(
                    build_similarity_graph, film, project.row_looks, visible, p
                )
                from finloop.forecast.learning import train_predictor  # loads torch, in 2 s

                model, curve = train_predictor(film, parts, p, advance)
                graph = graph_job.result()
        except FinloopError as error:
            _save_reason(folder, error)
            return
        save_json(folder / "model.json", model.to_values())
        sampler = build_sampler(film, model, graph, p)
        rng = np.random.default_rng((p.seed, 1))  # `split_held_out` has (p.seed, 0) and (p.seed, 2)
        # `Project.forecast_sampler` maps these files: similar rows, and the predicted states.
        save_array(folder / "start.npy", sampler.start)
        save_array(folder / "neighbours.npy", sampler.to)
        save_array(folder / "mean.npy", sampler.mean)
        numbers = _measure_forecast(film, sampler, parts, rng, folder)
        numbers |= _area_errors(project, model, parts)
    save_csv(REPORT / "curve.csv", curve[CURVE], decimals=4)
    save_metrics(REPORT / "metrics.json", {
        "models": 1,
        "state_numbers": len(film.scale),
        "mirrored": int(len(film.states) > film.count),
        "train_rows": len(parts.train),
        "held_out_rows": len(parts.held_out),
        "epochs": len(curve) - 1,
        "best_epoch": int(curve["held_out_error"].argmin()),
        "neighbours_per_row": len(sampler.to) / len(film.rows),  # `to`: those of all rows
        **numbers,
    })  # fmt: skip


if __name__ == "__main__":
    run(main)
