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

from finloop.base.errors import FinloopError
from finloop.base.line import PX
from finloop.io.atomic import save_bytes
from finloop.io.journal import hold_journal, save_journal
from finloop.plan.load_paths import load_track_or_file
from finloop.project import Project
from finloop.show.alone import build_standalone_page
from finloop.show.web import HOST, AccessPolicy, AppServer, bind_socket
from finloop.stimulus.inputs import receive_datagrams
from finloop.stimulus.listing import describe_points, describe_protocol
from finloop.stimulus.log import SESSION, Log
from finloop.stimulus.motion import plan_all_trials
from finloop.stimulus.order import order_trials
from finloop.stimulus.protocol import Protocol
from finloop.stimulus.protocol_file import load_protocol, parse_protocol
from finloop.stimulus.recorded import (
    NAME,
    ConnectionFaults,
    DryClock,
    TimedMessage,
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
from stages.stimulus_scene import (
    FilmedScene,
    display_file,
    load_display_calibration,
    look_messages,
    open_scene,
)

PORT, OUT = 8760, Path("sessions")


def main() -> None:
    """Run the command that the command line names."""
    options = _build_parser().parse_args()
    options.does(options)


# --- commands


def show(options: argparse.Namespace) -> None:
    """Show a protocol to animals until Ctrl-C, and write the session's file."""
    protocol = load_protocol(options.protocol)
    print(describe_protocol(protocol, order_trials(protocol)))
    calibration = load_display_calibration(options.display, protocol.display.calibrated)
    with bind_socket(options.port, options.listen) as listens, open_scene(protocol) as film:
        _print_points(protocol, film.context.tank.width, film.context.tank.height)
        messages = _animal_messages(options, film, protocol)
        with _open_session(options, protocol, film, RealClock(), display=calibration) as session:
            name = options.display
            hub = SessionHub(session, name, display_file(name), partial(_check_screen, film, name))
            if session.screen:
                print(session.screen[0])
            session.connect_outputs(hub.send, hub.send_trigger)
            policy = _access_policy(options, listens)
            session.link = _page_address(options, listens, policy, "show")
            inputs = _make_inputs(options, policy, session, messages)
            announce = partial(_announce_page, options, listens, policy)
            _run_server(create_session_server(listens, policy, hub, inputs, announce))


def _check_screen(film: FilmedScene, name: str) -> tuple[str, bool] | None:
    """Return how much of the tank a display shows, in words, and whether it is not all of it.

    name: of the display. None if it is not calibrated.
    """
    check = film.screen_check(name)
    return (check.describe_tank(), check.share_outside > 0) if check else None


def dry_run(options: argparse.Namespace) -> None:
    """Run a protocol without a display, as fast as possible, and write the session's file.

    The exit status is 1 if a fish leaves the screen of the display, as far as that is calibrated.
    """
    protocol = load_protocol(options.protocol)
    print(describe_protocol(protocol, order_trials(protocol)))
    with open_scene(protocol) as film:
        _print_points(protocol, film.context.tank.width, film.context.tank.height)
        check = film.screen_check(options.display)
        unknown = f"the display {options.display} is not calibrated: its size is unknown"
        print(check.describe_tank() if check else unknown)
        clock = DryClock(repeat_messages(_animal_messages(options, film, protocol)))
        with _open_session(options, protocol, film, clock, dry=True) as session:
            clock.receive = session.receive_message
            session.waits_for_starts = False  # nobody is there to press a key
            if check:
                session.watch_tick = check.count_tick
            session.start()
            asyncio.run(session.run_trials())
    if check:
        print(check.describe_ticks())
        if check.ticks_outside:
            sys.exit(1)


def list_only(options: argparse.Namespace) -> None:
    """Print the trials of a protocol."""
    protocol = load_protocol(options.protocol)
    print(describe_protocol(protocol, order_trials(protocol)))
    if protocol.animals is not None and protocol.animals.points:
        facts = Project().facts
        _print_points(protocol, facts.width_px, facts.height_px)


def replay(options: argparse.Namespace) -> None:
    """Show a session again, or check that this is possible."""
    record = open_session_record(options.session)
    protocol = parse_protocol(record.header["protocol"], Path(record.header["folder"]))
    with open_scene(protocol) as film:
        if changes := film.find_changes_since(record.header):
            raise FinloopError(
                f"{options.session} was made from another {', '.join(changes)}",
                "the stages' results and parameters (animate, matching) of that session",
                "run the pipeline on that film with the parameters in the session's file",
            )
        if options.check:
            check = replan_session(record, film.context, protocol)
            print(f"replay: {check.ticks} ticks planned again, {check.different} differ")
            if check.different:
                sys.exit(1)
            if not options.draw:
                return
        feed = film.feed(
            record.header["looks"], protocol.fish, display=record.header["display"], mode="replay",
            digest=True, name="replay", keys=[],
        )  # fmt: skip
        hub = ReplayHub(feed, read_displayed_frames(record), options.quick)
        with bind_socket(options.port) as listens:
            policy = AccessPolicy(listens.getsockname()[1])
            announce = partial(_announce_page, options, listens, policy)
            _run_server(create_display_server(listens, policy, hub, announce))
    print(
        f"replay: {hub.shown} frames drawn, pixels of {hub.compared} compared, "
        f"{len(hub.different)} differ"
    )
    if hub.different:
        sys.exit(1)


def page(options: argparse.Namespace) -> None:
    """Make a page that plays a protocol without a server, if all motion is known in advance."""
    protocol = load_protocol(options.protocol)
    with open_scene(protocol) as film:
        motion = plan_all_trials(film.context, protocol, order_trials(protocol))
        text = build_standalone_page(
            protocol.name, film.context.rate_hz, film.tank.floor,
            film.pictures.load_pictures(motion), motion, look_messages(protocol), loops=False,
        )  # fmt: skip
    save_bytes(options.out, text.encode())
    print(f"stimulus: {options.out} plays by itself")


def recover(options: argparse.Namespace) -> None:
    """Make a session's file from the journal of an interrupted session."""
    path = options.journal.with_suffix(".parquet")
    with hold_journal(options.journal):
        if path.exists():
            raise FinloopError(
                f"{path} exists already",
                "a session without its file: no file is overwritten",
                "use that file; or move it away, then recover the journal again",
            )
        _write_session_file(options.journal, path, recovered=True)
    print(f"stimulus: {options.journal} stays; delete it once the session's file is as it should")


def calibrate(options: argparse.Namespace) -> None:
    """Calibrate a display, until the calibration is stored."""
    calibration = load_display_calibration(options.display, required=False)
    with bind_socket(options.port, options.listen) as listens, open_scene() as film:
        feed = film.feed(
            looks=[], fish=0, display=calibration, mode="calibrate", digest=False,
            name=options.display, keys=[],
        )  # fmt: skip
        path = display_file(options.display)
        hub = CalibrationHub(feed, path, lambda: print(f"calibrate: stored in {path}"))
        policy = _access_policy(options, listens)
        announce = partial(_announce_page, options, listens, policy)
        _run_server(create_display_server(listens, policy, hub, announce))


# --- parts


def _print_points(protocol: Protocol, width: float, height: float) -> None:
    """Print where the tracker's points fall in a tank of a size in px; FinloopError if wrong."""
    if protocol.animals is not None and (text := describe_points(protocol.animals, width, height)):
        print(f"\n{text}")


@contextmanager
def _open_session(
    options: argparse.Namespace, protocol: Protocol, film: FilmedScene, clock: Any, **facts: Any
) -> Iterator[Session]:
    """Yield a new session; when it ends write its file and description, and again at the exit.

    What is logged after the session's end, such as a note, is only in the second writing. clock: a
    RealClock, or one that does not wait. facts: further fields of the file's header.
    """
    trials = order_trials(protocol)
    stamp = datetime.now().strftime("%Y-%m-%dT%H-%M-%S")
    name = re.sub(r"[^\w-]+", "-", protocol.name).strip("-") or "session"
    path = options.out / f"{stamp}_{name}.parquet"
    journal = path.with_suffix(".journal")
    looks = look_messages(protocol)
    # The command `dry` has no option --digest.
    feed = film.feed(
        looks, protocol.fish, display=facts.get("display"), mode="session",
        digest=getattr(options, "digest", False), name=options.display,
        keys=[protocol.start_key] if protocol.start_key else [],
    )  # fmt: skip
    fields = {"display": None, "folder": str(options.protocol.parent)} | facts
    log = Log(journal, film.header(protocol, trials, **fields))
    with hold_journal(journal):  # so that `recover` refuses it until the file is whole
        try:
            session = Session(film.context, protocol, trials, feed, log, clock)
            session.name = str(path)
            session.save_file = partial(_write_session_file, journal, path)
            try:
                yield session
            finally:
                session.log_unwritten()
        finally:
            log.close()
            _write_session_file(journal, path)
            journal.unlink()


def _write_session_file(journal: Path, path: Path, recovered: bool = False) -> None:
    """Convert a session's journal to the file `path` and a description (.md).

    recovered: whether the session was interrupted; then the description says so.
    """
    save_journal(journal, path, SESSION)
    save_bytes(
        path.with_suffix(".md"), summarise_session(open_session_record(path), recovered).encode()
    )
    print(f"stimulus: the session is in {path}, its description in {path.with_suffix('.md')}")


def _animal_messages(
    options: argparse.Namespace, film: FilmedScene, protocol: Protocol
) -> list[TimedMessage]:
    """Return the messages, (time [s], text), that a recorded track sends in place of a live animal.

    Without --animal there are none; with it, FinloopError if the protocol has no live animals.
    """
    if options.animal is None:
        return []
    if protocol.animals is None:
        raise FinloopError(
            f"--animal {options.animal} is given, and {options.protocol} has no live animals",
            "a protocol with `animals`",
            "add animals: {unit: px} to it, or leave --animal out",
        )
    context, faults = film.context, ConnectionFaults(options.loss, options.jitter, options.gap)
    line = load_track_or_file(options.animal, PX, Project().features)
    tracker = fit_calibration(protocol.animals, context.mm_per_px)
    return list(imitate_tracker(
        line, rate_hz=None, tank=context.tank, faults=faults, calibration=tracker,
        mm_per_px=context.mm_per_px,
    ))  # fmt: skip


def _make_inputs(
    options: argparse.Namespace, policy: AccessPolicy, session: Session,
    messages: list[TimedMessage],
) -> Callable[[], list[Coroutine[Any, Any, None]]]:  # fmt: skip
    """Return a function that makes the tasks through which messages reach a session.

    They listen at the ports --udp and --osc, and send `messages`, those of a recorded track.
    """

    async def listen(kind: str, port: int) -> None:
        """Receive the messages of trackers at a port of this machine; kind: "udp" or "osc"."""
        bound = bind_socket(port, options.listen, socket.SOCK_DGRAM)
        await receive_datagrams(bound, kind, session.receive_message, policy.token)

    async def play_messages() -> None:
        """Send the messages of the recorded track when they are due."""
        for due, text in repeat_messages(messages):
            await session.clock.wait_until(due)
            session.receive_message(text, NAME)

    def make_tasks() -> list[Coroutine[Any, Any, None]]:
        """Return a task for each port in use, and one for the recorded messages."""
        ports = {"udp": options.udp, "osc": options.osc}
        listening = [listen(kind, port) for kind, port in ports.items() if port]
        return listening + ([play_messages()] if messages else [])

    return make_tasks


def _access_policy(options: argparse.Namespace, listens: socket.socket) -> AccessPolicy:
    """Return who may connect: this machine; with --listen also others that know a secret token.

    listens: the bound socket.
    """
    port = listens.getsockname()[1]
    return AccessPolicy(port, None if options.listen == HOST else secrets.token_urlsafe(16))


def _page_address(
    options: Any, listens: socket.socket, policy: AccessPolicy, page: str = ""
) -> str:
    """Return the address of a page on the server, with the token if there is one.

    listens: the bound socket. page: below the server's root.
    """
    host, port = listens.getsockname()
    host = socket.gethostname() if host == "0.0.0.0" else host
    return f"http://{host}:{port}/{page}" + (f"?token={policy.token}" if policy.token else "")


def _announce_page(
    options: argparse.Namespace, listens: socket.socket, policy: AccessPolicy
) -> None:
    """Print the page's address, and open the page unless --no-open is given.

    listens: the bound socket.
    """
    url = _page_address(options, listens, policy)
    print(f"stimulus: open {url} (Ctrl-C ends it)", file=sys.stderr)
    if options.open:
        open_in_browser(url)


def _run_server(server: AppServer) -> None:
    """Run the server until it ends or Ctrl-C is pressed."""
    try:
        server.serve_until_stopped()
    except KeyboardInterrupt:
        print("\nstimulus: ended", file=sys.stderr)


def _build_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line; each command sets `does` to its function."""
    parser = argparse.ArgumentParser(
        prog="python -m stages.stimulus", description="A stimulus for animals; docs/stimulus.md."
    )
    commands = parser.add_subparsers(required=True, metavar="command")

    def add_command(does: Callable[[argparse.Namespace], None], *paths: str) -> Any:
        """Add a command with its arguments, all paths; return its parser."""
        name = does.__name__.partition("_")[0]  # `dry_run` has the command `dry`
        command = commands.add_parser(name, help=(does.__doc__ or "").rstrip("."))
        command.set_defaults(does=does)
        for path in paths:
            command.add_argument(path, type=Path)
        return command

    add_command(list_only, "protocol")
    show_parser, dry_parser = add_command(show, "protocol"), add_command(dry_run, "protocol")
    replay_parser, calibrate_parser = add_command(replay, "session"), add_command(calibrate)
    add_command(recover, "journal")
    add_command(page, "protocol", "out")
    for command in (show_parser, dry_parser):
        command.add_argument("--out", type=Path, default=OUT, help=f"folder; default {OUT}/")
        animal = command.add_argument_group("a recorded track as the live animal")
        animal.add_argument("--animal", help="track:8 of the film, or a file; see docs/paths.md")
        for name, most, text in (
            ("--loss", 0.99, "share of messages lost"), ("--jitter", 60.0, "of arrival times, s"),
            ("--gap", 60.0, "s of silence every 10 s"),
        ):  # fmt: skip
            animal.add_argument(name, type=_number_up_to(most), default=0.0, help=text)
    for command in (show_parser, dry_parser, calibrate_parser):
        command.add_argument("--display", default="display", help="its name; default display")
    for command in (show_parser, calibrate_parser):
        command.add_argument("--listen", default=HOST, help="address of this machine for others")
    for command in (show_parser, calibrate_parser, replay_parser):
        command.add_argument("--port", type=int, default=PORT, help=f"default {PORT}; 0 = any free")
        command.add_argument("--no-open", dest="open", action="store_false", help="open no browser")
    add_option = show_parser.add_argument
    add_option("--udp", type=int, help="port for trackers")
    add_option("--osc", type=int, help="port for trackers")
    add_option("--digest", action="store_true", help="log every frame's digest; slow")
    add_option = replay_parser.add_argument
    add_option("--check", action="store_true", help="plan again and compare; no display")
    add_option("--draw", action="store_true", help="after --check, draw as well")
    add_option("--quick", action="store_true", help="draw as fast as possible")
    return parser


def _number_up_to(most: float) -> Callable[[str], float]:
    """Return a function that parses a command-line number from 0 to `most`; it refuses others."""

    def parse_number(text: str) -> float:
        """Parse a number; raise an error if it is out of range."""
        if not 0 <= float(text) <= most:
            raise argparse.ArgumentTypeError(f"{text} is not 0 … {most:g}")
        return float(text)

    return parse_number


if __name__ == "__main__":
    run(main)
