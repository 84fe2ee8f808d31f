"""Watches commands for what leaves the machine or is written outside the given folders.

Every command runs in its own network, which has loopback alone. There the kernel counts what would leave, also by
native code, and a recorder answers name look-ups with an unreachable address, so that the caller goes on to connect.
The disk is an overlay: files written outside the working folder and ``/dev`` are in its upper layer. If a system
permits neither, an audit hook in every Python process and the home folder replace them; ``how`` says so. The command
"control" imports onnxruntime without the telemetry switch, which shows that the watch works.
"""

from __future__ import annotations

import fcntl
import json
import os
import re
import shutil
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path

from serving import PATIENCE_S, http_client, stream_client, wait_until_warm
from signsplice.lexicon import open_shipped_lexicon

ROOT = Path(__file__).resolve().parents[1]
SOURCES = tuple(ROOT / part / "src" for part in ("", "workshop", "research"))
_PROGRAM = (sys.executable, "-m", "signsplice")
_SWITCH = "ORT_DISABLE_TELEMETRY"
_BUILD_SERVERS = [
    "APPVEYOR",
    "BITBUCKET_BUILD_NUMBER",
    "BUILDKITE",
    "CI",
    "CIRCLECI",
    "CODEBUILD_BUILD_ID",
    "GITHUB_ACTIONS",
    "GITLAB_CI",
    "JENKINS_URL",
    "TEAMCITY_VERSION",
    "TF_BUILD",
    "TRAVIS",
]
"""Environment variables at which onnxruntime 1.32 sends nothing: a user has none of them."""
_ADDRESS = "198.51.100.7"
"""Answer to look-ups: an address of the range for documentation."""
_LINGER_S = 12.0
"""Time that a service waits after its last answer, s: onnxruntime looks up names 5 to 9 s after its import."""
_CONTROL = """
import onnxruntime, os, pathlib, time
end = time.monotonic() + 120 * os.environ["SIGNSPLICE_WATCHED_BY"].startswith("network")
while time.monotonic() < end and pathlib.Path("/proc/net/snmp").read_text().splitlines()[1].split()[12] == "0":
    time.sleep(0.1)
"""
"""Imports onnxruntime and waits for its first attempt without a route, at most two minutes."""
_WATCHED = "SIGNSPLICE_WATCHED"
"""Environment variable: the hook's log, and the working folder. With ``_BY`` added: the means of watching."""
_HOOK = """
import os, sys
_log, _given = os.environ["SIGNSPLICE_WATCHED"].split(os.pathsep)
def _note(kind, what):
    handle = os.open(_log, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    os.write(handle, f"{kind} {what}\\n".encode("utf-8", "replace"))
    os.close(handle)
def _audit(event, args, busy=[]):
    if busy or event not in ("socket.connect", "socket.sendto", "socket.getaddrinfo", "open"):
        return
    busy.append(1)
    try:
        if event == "socket.getaddrinfo":
            if args[0] not in (None, "", "localhost", b"localhost") and not str(args[0])[:1].isdigit():
                _note("name", args[0])
        elif event.startswith("socket"):
            if isinstance(args[1], tuple) and not str(args[1][0]).startswith(("127.", "::1", "localhost")):
                _note("socket", args[1][0])
        elif isinstance(args[0], (str, bytes)) and args[2] & (os.O_WRONLY | os.O_RDWR):
            path = os.path.abspath(os.fsdecode(args[0]))
            if not path.startswith((_given + os.sep, "/dev/", "/proc/")):
                _note("file", path)
    finally:
        busy.clear()
sys.addaudithook(_audit)
"""
"""``sitecustomize`` of every Python process that is watched."""


@dataclass
class SideEffects:
    """Side effects of a command.

    status: its exit status.
    sockets: number of attempts to reach an address that is not loopback.
    names: names looked up.
    files: files outside the working folder.
    how: means by which it was watched.
    errors: the end of its standard error.
    """

    status: int = 0
    sockets: int = 0
    names: list[str] = field(default_factory=list)
    files: list[str] = field(default_factory=list)
    how: str = ""
    errors: str = ""


# --- commands: each has its inputs in the working folder, and may write there


def _make_calls(*calls: str) -> list[list[str]]:
    return [[*_PROGRAM, *call.split()] for call in calls]


def make_python_call(code: str) -> list[str]:
    """Returns a call of Python."""
    return [sys.executable, "-c", code]


_RECIPES = "bulk recipes -o recipes.csv --count 4 --words 2:3"
COMMANDS: dict[str, list[list[str]]] = {
    "control": [make_python_call(_CONTROL)],
    "import": [make_python_call("import signsplice as ss; ss.splice([ss.load('a.bvh'), ss.load('b.bvh')])")],
    "splice": _make_calls("splice a.bvh b.bvh -o splice.glb --report splice.json"),
    "sentence": [[*_PROGRAM, "sentence", "HELLO I SIGN", "-o", "sentence.bvh"]],
    "serve": [[sys.executable, str(Path(__file__)), "--requests"]],
    "bulk": _make_calls(_RECIPES, "bulk sentences recipes.csv -o rows --workers 2"),
    "train": _make_calls(
        "synth endless -o signing --signers 2 --words 4 --seams 4 --processes 2",
        "train cutter --signing signing --out bundle --scale smoke --steps 2 --device cpu",
        "train transition --signing signing --out bundle --scale smoke --steps 2 --device cpu",
        "export bundle -o small",
    ),
    "bulk on Ray": _make_calls(_RECIPES, "bulk sentences recipes.csv -o rows --ray local --workers 1"),
}
"""Name -> calls."""


def _call_service() -> None:
    """Starts a service, calls every route that works, and lets it wait a while."""
    with http_client("serve") as client:
        wait_until_warm(client)
        client.post("/v1/sentence?file=bvh", json={"glosses": ["HELLO", "DEAF", "FRIEND"]}).raise_for_status()
        files = [("files", (name, Path(name).read_bytes())) for name in ("a.bvh", "b.bvh")]
        client.post("/v1/splice?file=glb", files=files).raise_for_status()
        client.post("/v1/sentence", json={"text": "how are you", "mesh": False}).raise_for_status()
        form = {"options": json.dumps({"text": "hello", "formats": ["vrma"]})}
        avatar = {"avatar": ("a.glb", Path("a.glb").read_bytes())}
        client.post("/v1/fit", files=avatar, data=form).raise_for_status()
        with stream_client(client, proxy=None) as stream:
            for message in (
                '{"type": "open", "paced": false}',
                '{"type": "word", "gloss": "HELLO"}',
                '{"type": "end"}',
            ):
                stream.send(message)
            while '"done"' not in str(stream.recv(timeout=PATIENCE_S)):
                pass
        time.sleep(_LINGER_S)


# --- the watch


def watch_calls(calls: Sequence[Sequence[str]], work: Path, switch: str | None = None) -> SideEffects:
    """Returns the side effects of calls, which work in the folder ``work``. ``switch``: value of the telemetry's own
    variable, if set.
    """
    for name in ("home", "tmp", "hook"):
        (work / ".watch" / name).mkdir(parents=True, exist_ok=True)
    (work / ".watch" / "hook" / "sitecustomize.py").write_text(_HOOK)
    script = [sys.executable, str(Path(__file__)), "--watch", str(work), json.dumps([list(call) for call in calls])]
    environment = {key: value for key, value in os.environ.items() if key not in (_SWITCH, *_BUILD_SERVERS)}
    environment |= {"PYTHONDONTWRITEBYTECODE": "1"} | ({} if switch is None else {_SWITCH: switch})
    user_options = [] if os.geteuid() == 0 else ["--map-root-user"]
    for namespaces, means in ((["--net", "--mount"], "network, disk"), ([], "audit hook, home")):
        prefix = ["unshare", *user_options, *namespaces] if namespaces else []
        if prefix and not _can_run([*prefix, "true"]):
            continue
        call = [*prefix, *script, means]
        process = subprocess.run(call, env=environment, capture_output=True, text=True, check=False)
        if process.returncode:
            raise RuntimeError(process.stderr[-2000:])
        return SideEffects(**json.loads(process.stdout.splitlines()[-1]))
    raise AssertionError


def _can_run(call: list[str]) -> bool:
    return shutil.which(call[0]) is not None and not subprocess.run(call, capture_output=True, check=False).returncode


def _watch(work: Path, calls: list[list[str]], means: str) -> SideEffects:
    """Runs calls and watches them, in the namespaces that ``watch_calls`` made."""
    effects, watch_folder, names = SideEffects(how=means), work / ".watch", list[str]()
    root: Path | None = None
    if means.startswith("network"):
        _open_loopback()
        _answer_names(names, watch_folder)
        root = _mount_overlay(watch_folder, work)
        effects.how = "network, disk" if root else "network, home"
    environment = os.environ | {
        "HOME": str(watch_folder / "home"),
        "TMPDIR": str(watch_folder / "tmp"),
        "PYTHONPATH": os.pathsep.join(map(str, (watch_folder / "hook", *SOURCES))),
        _WATCHED + "_BY": effects.how,
        _WATCHED: f"{watch_folder / 'log'}{os.pathsep}{work}",
        "OMP_NUM_THREADS": "1",
    }
    for name in ("XDG_CACHE_HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME"):
        environment.pop(name, None)
    before = _count_unroutable()

    def enter() -> None:
        if root is not None:
            os.chroot(root)
        os.chdir(work)

    run = partial(subprocess.run, env=environment, preexec_fn=enter, stdin=subprocess.DEVNULL, check=False)
    for call in calls:
        process = run(call, capture_output=True, text=True)
        effects.status, effects.errors = process.returncode, process.stderr[-2000:]
        if process.returncode:
            break
    time.sleep(0.5)
    effects.sockets, effects.names = _count_unroutable() - before, names
    files = {path for name in ("home", "tmp") for path in (watch_folder / name).rglob("*") if not path.is_dir()}
    short = {f"{watch_folder}/home": "~", f"{watch_folder}/tmp": "$TMPDIR"}
    effects.files = [
        re.sub("|".join(map(re.escape, short)), lambda m: short[m[0]], str(path)) for path in sorted(files)
    ]
    if root is not None:
        upper = root.parent / "upper"
        effects.files += [f"/{path.relative_to(upper)}" for path in sorted(upper.rglob("*")) if not path.is_dir()]
    with suppress(FileNotFoundError):
        for line in (watch_folder / "log").read_text().splitlines():
            kind, _, value = line.partition(" ")
            if kind == "file" and value not in effects.files and Path(value).exists():
                effects.files.append(value)
            elif kind == "name" and value not in effects.names:
                effects.names.append(value)
            elif kind == "socket" and root is None and not means.startswith("network"):
                effects.sockets += 1
    return effects


def _open_loopback() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        up = struct.pack("16sh14x", b"lo", 0x1 | 0x40)  # IFF_UP, IFF_RUNNING
        fcntl.ioctl(any_socket, 0x8914, up)  # SIOCSIFFLAGS


def _answer_names(names: list[str], watch_folder: Path) -> None:
    """Answers every look-up with ``_ADDRESS`` and records its name."""
    (watch_folder / "resolv.conf").write_text("nameserver 127.0.0.1\noptions timeout:1 attempts:2\n")
    subprocess.run(["mount", "--bind", str(watch_folder / "resolv.conf"), "/etc/resolv.conf"], check=True)
    server = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    server.bind(("127.0.0.1", 53))

    def answer() -> None:
        while True:
            query, client = server.recvfrom(4096)
            labels, position = [], 12
            while query[position]:
                labels.append(query[position + 1 : position + 1 + query[position]].decode("latin-1"))
                position += 1 + query[position]
            names.append(".".join(labels))
            question = query[12 : position + 5]
            is_v4 = query[position + 1 : position + 3] == b"\0\1"
            head = query[:2] + b"\x81\x80\0\1" + (b"\0\1" if is_v4 else b"\0\0") + bytes(4)
            record = b"\xc0\x0c\0\1\0\1\0\0\0\1\0\4" + socket.inet_aton(_ADDRESS) if is_v4 else b""
            server.sendto(head + question + record, client)

    threading.Thread(target=answer, daemon=True).start()


def _mount_overlay(watch_folder: Path, work: Path) -> Path | None:
    """Mounts and returns a root folder over this one, whose writes go into the folder ``upper`` beside it; the working
    folder and the devices are this system's own. Returns None if it cannot be mounted.
    """
    layers = watch_folder / "layers"
    layers.mkdir()

    def mount(*arguments: str) -> None:
        subprocess.run(["mount", *arguments], check=True, capture_output=True)

    try:
        mount("-t", "tmpfs", "none", str(layers))
        for name in ("upper", "inner", "top"):
            (layers / name).mkdir()
        options = f"lowerdir=/,upperdir={layers / 'upper'},workdir={layers / 'inner'}"
        mount("-t", "overlay", "overlay", "-o", options, str(layers / "top"))
        for folder in ("/proc", "/sys", "/dev", str(work)):
            mount("--rbind", folder, f"{layers / 'top'}{folder}")
        mount("--bind", str(watch_folder / "resolv.conf"), f"{layers / 'top'}/etc/resolv.conf")
    except subprocess.CalledProcessError:
        return None
    return layers / "top"


def _count_unroutable() -> int:
    """Returns how often something in this network tried to reach an address without a route."""
    lines = [line.split()[1:] for line in Path("/proc/net/snmp").read_text().splitlines() if line.startswith("Ip: ")]
    n_attempts = int(dict(zip(*lines, strict=True))["OutNoRoutes"])
    with suppress(FileNotFoundError):  # no IPv6
        match = re.search(r"^Ip6OutNoRoutes\s+(\d+)", Path("/proc/net/snmp6").read_text(), re.MULTILINE)
        n_attempts += int(match[1]) if match else 0
    return n_attempts


def watch_command(name: str, folder: Path, switch: str | None = None) -> SideEffects:
    """Runs one of ``COMMANDS``, in an empty folder. ``switch``: as in ``watch_calls``."""
    from signsplice.formats import save

    with open_shipped_lexicon() as words:
        for file, gloss in (("a.bvh", "HELLO"), ("b.bvh", "SIGN"), ("a.glb", "HELLO")):
            save(words.clip(gloss), folder / file)
    return watch_calls(COMMANDS[name], folder, switch)


if __name__ == "__main__":
    if sys.argv[1] == "--requests":
        _call_service()
    else:  # --watch
        print(json.dumps(asdict(_watch(Path(sys.argv[2]), json.loads(sys.argv[3]), sys.argv[4]))))
