"""Draw the pictures of several stages at once, on every core."""

from stages.run import THREADS, report_progress  # isort: skip  (before numpy)

from collections.abc import Sequence
from concurrent.futures.process import BrokenProcessPool
from importlib import import_module

from finloop.base.parallel import Processes, start_fork_server, worker_loss_error


def draw_all(modules: Sequence[str]) -> None:
    """Run `main` of each module in worker processes, several at a time.

    modules: names, the slowest first. FinloopError if the system kills a worker.
    """
    start_fork_server(modules)
    with report_progress("plots", len(modules), "stages") as advance:
        try:
            with Processes(THREADS).open_submitter(_run_module) as submit:
                for task in [submit(module) for module in modules]:
                    task.result()
                    advance()
        except BrokenProcessPool as error:
            raise worker_loss_error(THREADS) from error


def _run_module(module: str) -> None:
    """Import a module and run its `main`, which draws the pictures of one stage."""
    import_module(module).main()
