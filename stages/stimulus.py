"""Show a stimulus to animals: `python -m stages.stimulus show protocol.yaml` (docs/stimulus.md).

It is a program that reads the stages' results, not a stage.
"""

from stages.run import open_in_browser, run  # isort: skip  (before numpy)

import argparse
import asyncio
import re
import secrets
import socket
import sys
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

from starlette.applications import Starlette

from finloop.base.errors import FinloopError
from finloop.base.line import PX
from finloop.io.atomic import save_bytes
from finloop.io.journal import save_journal
from finloop.live.door import HOST, AppServer, Door, bind_socket
from finloop.plan.load_paths import line_of
from finloop.project import Project
from finloop.stimulus.apps import calibration_app, replay_app, session_app
from finloop.stimulus.course import whole_motion
from finloop.stimulus.display import DisplayCalibration
from finloop.stimulus.inputs import guard_input, open_osc, open_udp
from finloop.stimulus.listing import listing
from finloop.stimulus.log import SESSION, Log
from finloop.stimulus.order import trials
from finloop.stimulus.page import alone_page
from finloop.stimulus.protocol import Protocol, load_protocol, protocol_of
from finloop.stimulus.recorded import ConnectionFaults, messages
from finloop.stimulus.replay import frames_of, open_record, plan_again
from finloop.stimulus.session import Session
from finloop.stimulus.show import (
    CalibrationHub,
    DryClock,
    RealClock,
    Replay,
    SessionHub,
    repeat_messages,
)
from finloop.stimulus.summary import summary
from finloop.stimulus.tracker import calibration
from finloop.stimulus.trigger import Outlet
from stages.stimulus_scene import FilmedScene, display_file, known_display, looks_of, open_scene

PORT, OUT = 8760, Path("sessions")
Fail = Callable[[BaseException | None], None]  # ends a server, with an error or without


# --- commands


def show(asked: argparse.Namespace) -> None:
    """Show a protocol to animals, until Ctrl-C."""
    plan = list_trials(asked)
    known = known_display(asked.display, plan.display.calibrated)
    with bind_socket(asked.port, asked.listen) as listens, open_scene(plan) as film:
        recorded = _recorded_messages(asked, film, plan)
        with _open_session(asked, plan, film, RealClock(), display=_to_dict(known)) as session:
            hub = SessionHub(session, asked.display, display_file(asked.display))
            session.attach(hub.send, Outlet(hub.tell).send)
            door = _door(asked, listens)
            session.link = _address(asked, listens, door, "show")

            def make_app(fail: Fail) -> Starlette:
                hear = guard_input(session.hear, fail)
                tasks = partial(_input_tasks, asked, door, hear, recorded, session)
                return session_app(door, hub, tasks, fail)

            _serve(asked, listens, door, make_app)


def dry(asked: argparse.Namespace) -> None:
    """Run a protocol without a display, as fast as possible."""
    plan = list_trials(asked)
    with open_scene(plan) as film:
        clock = DryClock(repeat_messages(_recorded_messages(asked, film, plan)))
        with _open_session(asked, plan, film, clock, dry=True) as session:
            clock.hear, session.patient = session.hear, False
            session.start()
            asyncio.run(session.run())


def list_trials(asked: argparse.Namespace) -> Protocol:
    """Print the trials of a protocol."""
    plan = load_protocol(asked.protocol)
    print(listing(plan, trials(plan)))
    return plan


def replay(asked: argparse.Namespace) -> None:
    """Show a session again, or check that this is possible."""
    record = open_record(asked.session)
    plan = protocol_of(record.header["protocol"], Path(record.header["folder"]))
    with open_scene(plan) as film:
        if others := film.find_differences(record.header):
            raise FinloopError(
                f"{asked.session} was made from another {', '.join(others)}",
                "the stages' results and parameters (animate, matching) of that session",
                "run the pipeline on that film with the parameters in the session's file",
            )
        if asked.check:
            check = plan_again(record, film.scene, plan)
            print(f"replay: {check.ticks} ticks planned again, {check.different} differ")
            if check.different:
                sys.exit(1)
            if not asked.draw:
                return
        feed = film.feed(
            record.header["looks"], plan.fish, display=record.header["display"], mode="replay",
            digest=True, name="replay", keys=[],
        )  # fmt: skip
        shown = Replay(feed, frames_of(record), asked.quick)
        with bind_socket(asked.port) as listens:
            door = Door(listens.getsockname()[1])

            def make_app(fail: Fail) -> Starlette:
                return replay_app(door, shown, partial(fail, None), fail)

            _serve(asked, listens, door, make_app)
    print(
        f"replay: {shown.shown} frames drawn, pixels of {shown.compared} compared, "
        f"{len(shown.different)} differ"
    )
    if shown.different:
        sys.exit(1)


def page(asked: argparse.Namespace) -> None:
    """Make a page that plays a protocol without a server, if its motions are known in advance."""
    plan = load_protocol(asked.protocol)
    with open_scene(plan) as film:
        motion = whole_motion(film.scene, plan, trials(plan))
        text = alone_page(
            plan.name, film.scene.rate_hz, film.tank.floor, film.pictures.load_pictures(motion),
            motion, looks_of(plan), loops=False,
        )  # fmt: skip
    save_bytes(asked.out, text.encode())
    print(f"stimulus: {asked.out} plays by itself")


def recover(asked: argparse.Namespace) -> None:
    """Make a session's file from the journal of an interrupted session."""
    _finish(asked.journal, asked.journal.with_suffix(".parquet"), recovered=True)


def calibrate(asked: argparse.Namespace) -> None:
    """Calibrate a display, until the calibration is stored."""
    known, path = known_display(asked.display, False), display_file(asked.display)
    with bind_socket(asked.port, asked.listen) as listens, open_scene() as film:
        feed = film.feed(
            [], 0, display=_to_dict(known), mode="calibrate", digest=False, name=asked.display,
            keys=[],
        )  # fmt: skip
        hub = CalibrationHub(feed, path, lambda: print(f"calibrate: stored in {path}"))
        door = _door(asked, listens)
        _serve(asked, listens, door, partial(calibration_app, door, hub))


# --- parts


@contextmanager
def _open_session(
    asked: argparse.Namespace, plan: Protocol, film: FilmedScene, clock: Any, **facts: Any
) -> Iterator[Session]:
    """Yield a session that logs to a journal; after the block make the session's file of that."""
    order = trials(plan)
    stamp = datetime.now().strftime("%Y-%m-%dT%H-%M-%S")
    name = re.sub(r"[^\w-]+", "-", plan.name).strip("-") or "session"
    path = asked.out / f"{stamp}_{name}.parquet"
    journal = path.with_suffix(".journal")
    feed = film.feed(
        looks_of(plan), plan.fish, display=facts.get("display"), mode="session",
        digest=getattr(asked, "digest", False), name=getattr(asked, "display", "none"),
        keys=plan.keys,
    )  # fmt: skip
    facts = {"display": None, "folder": str(asked.protocol.parent)} | facts
    log = Log(journal, film.header(plan, order, **facts))
    try:
        session = Session(film.scene, plan, order, feed, log, clock)
        session.name = str(path)
        yield session
    finally:
        log.close()
        _finish(journal, path)


def _finish(journal: Path, path: Path, recovered: bool = False) -> None:
    save_journal(journal, path, SESSION)
    save_bytes(path.with_suffix(".md"), summary(open_record(path), recovered).encode())
    journal.unlink()
    print(f"stimulus: the session is in {path}, its description in {path.with_suffix('.md')}")


def _recorded_messages(
    asked: argparse.Namespace, film: FilmedScene, plan: Protocol
) -> list[tuple[float, str]]:
    """Return the messages, with their times, that a tracker would send of the track --animal."""
    if asked.animal is None:
        return []
    if plan.animals is None:
        raise FinloopError(
            f"--animal {asked.animal} is given, and {asked.protocol} has no live animals",
            "a protocol with `animals`",
            "add animals: {unit: px} to it, or leave --animal out",
        )
    scene, faults = film.scene, ConnectionFaults(asked.loss, asked.jitter, asked.gap)
    line = line_of(asked.animal, PX, Project().features)
    tracker = calibration(plan.animals, scene.mm_per_px)
    return list(messages(line, None, scene.tank, faults, tracker, mm_per_px=scene.mm_per_px))


def _input_tasks(
    asked: argparse.Namespace, door: Door, hear: Callable[[Any, str], None],
    recorded: list[tuple[float, str]], session: Session,
) -> list[Coroutine[Any, Any, None]]:  # fmt: skip
    """Return the tasks that receive trackers' messages: by UDP, by OSC, and recorded ones."""

    async def listen(opens: Any, port: int) -> None:
        listens = bind_socket(port, asked.listen, socket.SOCK_DGRAM)
        transport = await opens(listens, hear, door.token)
        try:
            await asyncio.Event().wait()
        finally:
            transport.close()

    async def play_recorded() -> None:
        for due, text in repeat_messages(recorded):
            await session.clock.until(due)
            hear(text, "recorded")

    tasks = [listen(open_udp, asked.udp)] if asked.udp else []
    tasks += [listen(open_osc, asked.osc)] if asked.osc else []
    return tasks + ([play_recorded()] if recorded else [])


def _to_dict(display: DisplayCalibration | None) -> dict[str, Any] | None:
    return None if display is None else display.model_dump(mode="json")


def _door(asked: argparse.Namespace, listens: socket.socket) -> Door:
    port = listens.getsockname()[1]
    return Door(port, None if asked.listen == HOST else secrets.token_urlsafe(16))


def _address(asked: Any, listens: socket.socket, door: Door, page: str = "") -> str:
    host, port = listens.getsockname()
    host = socket.gethostname() if host == "0.0.0.0" else host
    return f"http://{host}:{port}/{page}" + (f"?token={door.token}" if door.token else "")


def _serve(
    asked: argparse.Namespace, listens: socket.socket, door: Door,
    make_app: Callable[[Fail], Starlette],
) -> None:  # fmt: skip
    """Serve an application until Ctrl-C, or until it calls what `make_app` is given."""

    def announce() -> None:
        url = _address(asked, listens, door)
        print(f"stimulus: open {url} (Ctrl-C ends it)", file=sys.stderr)
        if asked.open:
            open_in_browser(url)

    server = AppServer(make_app(lambda error: server.fail(error)), listens, announce)
    try:
        server.serve_on()
    except KeyboardInterrupt:
        print("\nstimulus: ended", file=sys.stderr)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m stages.stimulus", description="A stimulus for animals; docs/stimulus.md."
    )
    commands = parser.add_subparsers(required=True, metavar="command")

    def command(does: Callable[[argparse.Namespace], Any], *paths: str) -> Any:
        name, help_text = does.__name__.partition("_")[0], (does.__doc__ or "").rstrip(".")
        added = commands.add_parser(name, help=help_text)
        added.set_defaults(does=does)
        for path in paths:
            added.add_argument(path, type=Path)
        return added

    command(list_trials, "protocol")
    shows, dries = command(show, "protocol"), command(dry, "protocol")
    again, calibrates = command(replay, "session"), command(calibrate)
    command(recover, "journal")
    command(page, "protocol", "out")
    for one in (shows, dries):
        one.add_argument("--out", type=Path, default=OUT, help=f"folder; default {OUT}/")
        animal = one.add_argument_group("a recorded track as the live animal")
        animal.add_argument("--animal", help="track:8 of the film, or a file; see docs/paths.md")
        animal.add_argument("--loss", type=_up_to(0.99), default=0.0, help="share of messages lost")
        animal.add_argument("--jitter", type=_up_to(60.0), default=0.0, help="of arrival times, s")
        animal.add_argument("--gap", type=_up_to(60.0), default=0.0, help="s of silence every 10 s")
    for one in (shows, calibrates):
        one.add_argument("--display", default="display", help="its name; default display")
        one.add_argument("--listen", default=HOST, help="address of this machine for others")
    for one in (shows, calibrates, again):
        one.add_argument("--port", type=int, default=PORT, help=f"default {PORT}; 0 = any free")
        one.add_argument("--no-open", dest="open", action="store_false", help="open no browser")
    shows.add_argument("--udp", type=int, help="port for trackers")
    shows.add_argument("--osc", type=int, help="port for trackers")
    shows.add_argument("--digest", action="store_true", help="log every frame's digest; slow")
    again.add_argument("--check", action="store_true", help="plan again and compare; no display")
    again.add_argument("--draw", action="store_true", help="after --check, draw as well")
    again.add_argument("--quick", action="store_true", help="draw as fast as possible")
    return parser


def _up_to(most: float) -> Callable[[str], float]:
    def number(text: str) -> float:
        if not 0 <= float(text) <= most:
            raise argparse.ArgumentTypeError(f"{text} is not 0 … {most:g}")
        return float(text)

    return number


def main() -> None:
    """Run the requested command."""
    asked = _parser().parse_args()
    asked.does(asked)


if __name__ == "__main__":
    run(main)
