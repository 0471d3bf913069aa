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
from pathlib import Path
from typing import Any

from finloop.base.errors import FinloopError
from finloop.base.line import PX
from finloop.io.atomic import save_bytes
from finloop.io.journal import save_journal
from finloop.live.web import HOST, AccessPolicy, AppServer, bind_socket
from finloop.plan.load_paths import line_of
from finloop.project import Project
from finloop.stimulus.inputs import receive_datagrams
from finloop.stimulus.listing import list_trials
from finloop.stimulus.log import SESSION, Log
from finloop.stimulus.motion import plan_all_trials
from finloop.stimulus.order import order_trials
from finloop.stimulus.page import build_standalone_page
from finloop.stimulus.protocol import Protocol
from finloop.stimulus.protocol_file import load_protocol, parse_protocol
from finloop.stimulus.recorded import (
    ConnectionFaults,
    DryClock,
    imitate_tracker,
    repeat_messages,
)
from finloop.stimulus.replay import open_session_record, read_displayed_frames, replan_session
from finloop.stimulus.serve import (
    CalibrationHub,
    ReplayHub,
    SessionHub,
    create_display_server,
    create_session_server,
)
from finloop.stimulus.session import RealClock, Session
from finloop.stimulus.summary import summarise_session
from finloop.stimulus.tracker import fit_calibration
from stages.stimulus_scene import FilmedScene, display_file, known_display, looks_of, open_scene

PORT, OUT = 8760, Path("sessions")


def main() -> None:
    """Run the requested command."""
    asked = _parser().parse_args()
    asked.does(asked)


# --- commands


def show(asked: argparse.Namespace) -> None:
    """Show a protocol to animals, until Ctrl-C."""
    plan = load_protocol(asked.protocol)
    print(list_trials(plan, order_trials(plan)))
    known = known_display(asked.display, plan.display.calibrated)
    with bind_socket(asked.port, asked.listen) as listens, open_scene(plan) as made:
        messages = _animal_messages(asked, made, plan)
        with _session(asked, plan, made, RealClock(), display=known) as session:
            hub = SessionHub(session, asked.display, display_file(asked.display))
            session.connect_outputs(hub.send, hub.send_trigger)
            policy = _policy(asked, listens)
            session.link = _address(asked, listens, policy, "show")
            inputs = _inputs(asked, policy, session, messages)
            started = _make_announcer(asked, listens, policy)
            _serve(create_session_server(listens, policy, hub, inputs, started))


def dry(asked: argparse.Namespace) -> None:
    """Run a protocol without a display, as fast as possible."""
    plan = load_protocol(asked.protocol)
    print(list_trials(plan, order_trials(plan)))
    with open_scene(plan) as made:
        clock = DryClock(repeat_messages(_animal_messages(asked, made, plan)))
        with _session(asked, plan, made, clock, dry=True) as session:
            clock.receive, session.waits_for_starts = session.receive_message, False
            session.start()
            asyncio.run(session.run_trials())


def list_only(asked: argparse.Namespace) -> None:
    """Print the trials of a protocol."""
    plan = load_protocol(asked.protocol)
    print(list_trials(plan, order_trials(plan)))


def replay(asked: argparse.Namespace) -> None:
    """Show a session again, or check that this is possible."""
    record = open_session_record(asked.session)
    plan = parse_protocol(record.header["protocol"], Path(record.header["folder"]))
    with open_scene(plan) as made:
        if others := made.find_differences(record.header):
            raise FinloopError(
                f"{asked.session} was made from another {', '.join(others)}",
                "the stages' results and parameters (animate, matching) of that session",
                "run the pipeline on that film with the parameters in the session's file",
            )
        if asked.check:
            check = replan_session(record, made.scene, plan)
            print(f"replay: {check.ticks} ticks planned again, {check.different} differ")
            if check.different:
                sys.exit(1)
        if asked.check and not asked.draw:
            return
        feed = made.feed(
            record.header["looks"], plan.fish, display=record.header["display"], mode="replay",
            digest=True, name="replay", keys=[],
        )  # fmt: skip
        room = ReplayHub(feed, read_displayed_frames(record), asked.quick)
        with bind_socket(asked.port) as listens:
            policy = AccessPolicy(listens.getsockname()[1])
            _serve(
                create_display_server(
                    listens, policy, room, _make_announcer(asked, listens, policy)
                )
            )
    print(
        f"replay: {room.shown} frames drawn, pixels of {room.compared} compared, "
        f"{len(room.different)} differ"
    )
    if room.different:
        sys.exit(1)


def page(asked: argparse.Namespace) -> None:
    """Make a page that plays a protocol without a server, if its motions are known in advance."""
    plan = load_protocol(asked.protocol)
    with open_scene(plan) as made:
        motion = plan_all_trials(made.scene, plan, order_trials(plan))
        text = build_standalone_page(
            plan.name, made.scene.rate_hz, made.tank.floor, made.pictures.load_pictures(motion),
            motion, looks_of(plan), loops=False,
        )  # fmt: skip
    save_bytes(asked.out, text.encode())
    print(f"stimulus: {asked.out} plays by itself")


def recover(asked: argparse.Namespace) -> None:
    """Make a session's file from the journal of an interrupted session."""
    _finish(asked.journal, asked.journal.with_suffix(".parquet"), recovered=True)


def calibrate(asked: argparse.Namespace) -> None:
    """Calibrate a display, until the calibration is stored."""
    known = known_display(asked.display, False)
    with bind_socket(asked.port, asked.listen) as listens, open_scene() as made:
        feed = made.feed(
            [], 0, display=known, mode="calibrate", digest=False, name=asked.display, keys=[],
        )  # fmt: skip
        path = display_file(asked.display)
        hub = CalibrationHub(feed, path, lambda: print(f"calibrate: stored in {path}"))
        policy = _policy(asked, listens)
        _serve(create_display_server(listens, policy, hub, _make_announcer(asked, listens, policy)))


# --- parts


@contextmanager
def _session(
    asked: argparse.Namespace, plan: Protocol, made: FilmedScene, clock: Any, **facts: Any
) -> Iterator[Session]:
    order = order_trials(plan)
    stamp = datetime.now().strftime("%Y-%m-%dT%H-%M-%S")
    name = re.sub(r"[^\w-]+", "-", plan.name).strip("-") or "session"
    path = asked.out / f"{stamp}_{name}.parquet"
    journal = path.with_suffix(".journal")
    looks = looks_of(plan)
    feed = made.feed(
        looks, plan.fish, display=facts.get("display"), mode="session",
        digest=getattr(asked, "digest", False), name=getattr(asked, "display", "none"),
        keys=[plan.start_key] if plan.start_key else [],
    )  # fmt: skip
    log = Log(
        journal,
        made.header(
            plan, order, **({"display": None, "folder": str(asked.protocol.parent)} | facts)
        ),
    )
    try:
        session = Session(made.scene, plan, order, feed, log, clock)
        session.name = str(path)
        yield session
    finally:
        log.close()
        _finish(journal, path)


def _finish(journal: Path, path: Path, recovered: bool = False) -> None:
    save_journal(journal, path, SESSION)
    save_bytes(
        path.with_suffix(".md"), summarise_session(open_session_record(path), recovered).encode()
    )
    journal.unlink()
    print(f"stimulus: the session is in {path}, its description in {path.with_suffix('.md')}")


def _animal_messages(
    asked: argparse.Namespace, made: FilmedScene, plan: Protocol
) -> list[tuple[float, str]]:
    if asked.animal is None:
        return []
    if plan.animals is None:
        raise FinloopError(
            f"--animal {asked.animal} is given, and {asked.protocol} has no live animals",
            "a protocol with `animals`",
            "add animals: {unit: px} to it, or leave --animal out",
        )
    scene, faults = made.scene, ConnectionFaults(asked.loss, asked.jitter, asked.gap)
    line = line_of(asked.animal, PX, Project().features)
    tracker = fit_calibration(plan.animals, scene.mm_per_px)
    return list(imitate_tracker(line, None, scene.tank, faults, tracker, scene.mm_per_px))


def _inputs(
    asked: argparse.Namespace, policy: AccessPolicy, session: Session,
    messages: list[tuple[float, str]],
) -> Callable[[], list[Coroutine[Any, Any, None]]]:  # fmt: skip

    async def listen(kind: str, port: int) -> None:
        bound = bind_socket(port, asked.listen, socket.SOCK_DGRAM)
        await receive_datagrams(bound, kind, session.receive_message, policy.token)

    async def play() -> None:
        for due, text in repeat_messages(messages):
            await session.clock.wait_until(due)
            session.receive_message(text, "recorded")

    def tasks() -> list[Coroutine[Any, Any, None]]:
        ports = {"udp": asked.udp, "osc": asked.osc}
        listening = [listen(kind, port) for kind, port in ports.items() if port]
        return listening + ([play()] if messages else [])

    return tasks


def _policy(asked: argparse.Namespace, listens: socket.socket) -> AccessPolicy:
    port = listens.getsockname()[1]
    return AccessPolicy(port, None if asked.listen == HOST else secrets.token_urlsafe(16))


def _address(asked: Any, listens: socket.socket, policy: AccessPolicy, page: str = "") -> str:
    host, port = listens.getsockname()
    host = socket.gethostname() if host == "0.0.0.0" else host
    return f"http://{host}:{port}/{page}" + (f"?token={policy.token}" if policy.token else "")


def _make_announcer(
    asked: argparse.Namespace, listens: socket.socket, policy: AccessPolicy
) -> Callable[[], None]:
    def announce() -> None:
        """Print the page's address, and open it if asked."""
        url = _address(asked, listens, policy)
        print(f"stimulus: open {url} (Ctrl-C ends it)", file=sys.stderr)
        if asked.open:
            open_in_browser(url)

    return announce


def _serve(server: AppServer) -> None:
    try:
        server.serve_until_stopped()
    except KeyboardInterrupt:
        print("\nstimulus: ended", file=sys.stderr)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m stages.stimulus", description="A stimulus for animals; docs/stimulus.md."
    )
    commands = parser.add_subparsers(required=True, metavar="command")

    def command(does: Callable[[argparse.Namespace], None], *what: str) -> Any:
        name = does.__name__.partition("_")[0]
        one = commands.add_parser(name, help=(does.__doc__ or "").rstrip("."))
        one.set_defaults(does=does)
        for each in what:
            one.add_argument(each, type=Path)
        return one

    command(list_only, "protocol")
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


if __name__ == "__main__":
    run(main)
