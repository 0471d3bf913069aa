"""Let Optuna choose the values of a sweep by its TPE sampler, and end bad trials early.

A trial is a combination of values. It runs with one seed after the other; the mean of the goal over
the seeds so far is reported to Optuna after each, and a trial that is worse than the median of the
others gets no further seed. As many trials run at a time as there are clones. All is drawn from one
seed, and existing experiments are reused: a sweep that was interrupted goes on.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from finloop.base.errors import FinloopError
from finloop.report.effects import good_direction
from finloop.report.headlines import HIGHER
from stages.experiment import Experiment, parse_interval, parse_values

DIGITS = 3  # of a proposed value: its name stays short, and no result depends on more
UNPRUNED = 5  # trials before one may be dropped
Overrides = dict[str, list[str]]  # run → overrides


def choose_goal(plan: Experiment) -> tuple[str, str]:
    """Return the measure that Optuna improves, and its good direction, HIGHER or LOWER.

    It is the sweep's goal, else its first measure with a direction. FinloopError if there is none.
    """
    names = [plan.goal] if plan.goal else plan.measures
    for name in names:
        if direction := good_direction(name):
            return name, direction
    raise FinloopError(
        f"it is unknown whether more or less is better: {', '.join(names)}",
        "a measure to improve whose good direction is known, such as bpn.held_out_area_rmse",
        "name such a measure: `goal` in the file of the sweep, or --goal",
    )


def optuna_distribution(values: str) -> Any:
    """Return values in Hydra's notation as a distribution of Optuna.

    An interval has continuous values, or whole ones, `int(interval(1, 9))`; a list has categories.
    """
    from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

    interval = parse_interval(values)
    if interval is None:
        return CategoricalDistribution(list(parse_values(values)))
    kind = IntDistribution if isinstance(interval.start, int) else FloatDistribution
    return kind(interval.start, interval.end, log="log" in interval.tags)


def make_trials(
    plan: Experiment, name: str, present: Mapping[str, int], at_once: int,
    make: Callable[[Overrides], dict[str, str]],
    measure: Callable[[str, str], float | None],
) -> tuple[Overrides, dict[str, str], str]:  # fmt: skip
    """Run the trials of a sweep; return all runs, the failed ones, and a sentence on the best.

    A trial is one combination of values, and has a run for each seed. After each seed, trials that
    do worse than others end. name: of the sweep. present: seed parameter → its present value.
    at_once: trials at a time. make: makes runs, and returns those that failed, with causes.
    measure(run, goal): returns the goal's value in a run, None if it has none. FinloopError if
    Optuna is missing, or the goal has no direction.
    """
    goal, direction = choose_goal(plan)
    study, states = _create_study(direction)
    space = {key: optuna_distribution(values) for key, values in plan.params.items()}
    seeds = range(plan.seeds if present else 1)
    runs, failures = Overrides(), dict[str, str]()
    for first in range(0, plan.trials, at_once):
        trials = [study.ask(space) for _ in range(min(at_once, plan.trials - first))]
        goal_values: dict[Any, list[float]] = {trial: [] for trial in trials}  # of those that go on
        for seed in seeds:
            batch, run_names = Overrides(), dict[Any, str]()
            for trial in goal_values:
                values = dict(map(_format_value, trial.params.items()))
                run = plan.build_run(name, values, present, seed)
                (run_names[trial],) = run  # it is one
                batch |= run
            runs |= batch
            failures |= make(batch)
            for trial, run_name in run_names.items():
                value = None if run_name in failures else measure(run_name, goal)
                if value is None:
                    study.tell(trial, state=states.FAIL)
                    del goal_values[trial]
                    continue
                goal_values[trial].append(value)
                trial.report(float(np.mean(goal_values[trial])), seed)
                if seed < seeds[-1] and trial.should_prune():
                    study.tell(trial, state=states.PRUNED)
                    del goal_values[trial]
        for trial, values_of_seeds in goal_values.items():
            study.tell(trial, float(np.mean(values_of_seeds)))
    return runs, failures, _describe_study(study, goal)


def _create_study(direction: str) -> tuple[Any, Any]:
    """Return a new Optuna study, and Optuna's names for the end states of a trial.

    direction: of the goal, HIGHER or LOWER is better. FinloopError if Optuna is missing.
    """
    try:
        import optuna
    except ImportError as error:
        raise FinloopError(
            "Optuna is not installed", "the environment of requirements.lock", "make setup"
        ) from error
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = optuna.create_study(
        direction="maximize" if direction == HIGHER else "minimize",
        sampler=optuna.samplers.TPESampler(seed=0, constant_liar=True),
        pruner=optuna.pruners.MedianPruner(n_startup_trials=UNPRUNED),
    )
    return study, optuna.trial.TrialState


def _format_value(item: tuple[str, Any]) -> tuple[str, str]:
    """Return a parameter's name and value as texts."""
    key, value = item
    return key, f"{value:.{DIGITS}g}" if isinstance(value, float) else str(value)


def _describe_study(study: Any, goal: str) -> str:
    """Return a sentence on the best trial of a study."""
    states = [trial.state.name for trial in study.trials]
    if "COMPLETE" not in states:
        return f"Optuna: none of {len(states)} trials has {goal}."
    best = ", ".join(
        f"{key} = {value}" for key, value in map(_format_value, study.best_params.items())
    )
    dropped = states.count("PRUNED")
    return (
        f"Optuna's best of {len(states)} trials, {dropped} of them dropped early: {best} "
        f"({goal} {study.best_value:.4g})."
    )
