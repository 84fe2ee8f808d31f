"""What leaves the machine, and what is written beside the folders given: ``python attacks/sockets.py [NAME ...]``.

Every command runs in a network of its own, which has loopback alone. There the kernel counts what would leave, native
code's too, and a recorder answers name look-ups with an address that leads nowhere, so that whoever asked goes on to
connect. The disk is an overlay: whatever is written outside the working folder and ``/dev`` is found in its upper
layer. Where a system permits neither, an audit hook in every Python process and the home folder stand in for them; the
last column says so. The row "control" imports onnxruntime as a stranger does, which shows that the watch works.
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
import tempfile
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path

import httpx
from websockets.sync.client import connect

from service_callers import WORDS, serving
from signsplice.lexicon import open_shipped_lexicon

ROOT = Path(__file__).resolve().parents[2]
SOURCES = tuple(ROOT / part / "src" for part in ("", "workshop", "research"))
_PROGRAM = (sys.executable, "-m", "signsplice")
_SWITCH = "ORT_DISABLE_TELEMETRY"
_ADDRESS = "198.51.100.7"
"""What look-ups are answered with: an address of the range for documentation."""
_LINGER_S = 12.0
"""How long a process goes on that has imported onnxruntime: its look-ups begin after 5 to 9 s."""
_WATCHED = "SIGNSPLICE_WATCHED"
"""Environment variable: where a hook writes, and the working folder. With ``_BY`` added: by what is watched."""
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
class Seen:
    """What a command did beside its work.

    status: its exit status.
    sockets: attempts to reach an address that is not loopback.
    names: names looked up.
    files: files outside the working folder.
    how: by what it was watched.
    errors: the last of its standard error.
    """

    status: int = 0
    sockets: int = 0
    names: list[str] = field(default_factory=list)
    files: list[str] = field(default_factory=list)
    how: str = ""
    errors: str = ""

    @property
    def is_clean(self) -> bool:
        """Whether nothing was sent, asked or left."""
        return not (self.sockets or self.names or self.files)

    def row(self) -> str:
        """Exit status, sockets, look-ups and foreign files, as cells of a table."""
        names = f"{len(self.names)} ({', '.join(sorted(set(self.names)))})" if self.names else "none"
        files = f"{len(self.files)} ({', '.join(self.files[:3])})" if self.files else "none"
        return f"{self.status} | {self.sockets or 'none'} | {names} | {files} | {self.how}"


# --- commands: each gets its inputs in the working folder, and may write there


def _signsplice(*calls: str) -> list[list[str]]:
    return [[*_PROGRAM, *call.split()] for call in calls]


def python(code: str) -> list[str]:
    """A call of Python."""
    return [sys.executable, "-c", code]


COMMANDS: dict[str, list[list[str]]] = {
    "control": [python(f"import onnxruntime, time; time.sleep({_LINGER_S})")],
    "import": [python("import signsplice as ss; ss.splice([ss.load('a.bvh'), ss.load('b.bvh')])")],
    "splice": _signsplice("splice a.bvh b.bvh -o splice.glb --report splice.json"),
    "sentence": [[*_PROGRAM, "sentence", "HELLO I SIGN", "-o", "sentence.bvh"]],
    "serve": [[sys.executable, str(Path(__file__)), "--requests"]],
    "bulk": _signsplice(
        "bulk recipes -o recipes.csv --count 4 --words 2:3", "bulk sentences recipes.csv -o rows --workers 2"
    ),
    "train": _signsplice(
        "synth endless -o signing --signers 2 --words 4 --seams 4 --processes 2",
        "train cutter --signing signing --out bundle --scale smoke --steps 2 --device cpu",
        "train transition --signing signing --out bundle --scale smoke --steps 2 --device cpu",
        "export bundle -o small",
    ),
    "bulk on Ray": _signsplice(
        "bulk recipes -o recipes.csv --count 4 --words 2:3",
        "bulk sentences recipes.csv -o rows --ray local --workers 1",
    ),
}
"""Calls by the name of their row."""


def _ask_a_service() -> None:
    """Start a service, call every route that works, and let it wait a while."""
    with serving() as (address, _):
        with httpx.Client(base_url=address, timeout=300.0, trust_env=False) as client:
            while client.get("/healthz").status_code == 503:
                time.sleep(0.1)
            client.post("/v1/sentence?file=bvh", json={"glosses": list(WORDS[:3])}).raise_for_status()
            files = [("files", (name, Path(name).read_bytes())) for name in ("a.bvh", "b.bvh")]
            client.post("/v1/splice?file=glb", files=files).raise_for_status()
            client.post("/v1/sentence", json={"text": "how are you", "mesh": False}).raise_for_status()
            form = {"options": json.dumps({"text": "hello", "formats": ["vrma"]})}
            client.post(
                "/v1/fit", files={"avatar": ("a.glb", Path("a.glb").read_bytes())}, data=form
            ).raise_for_status()
        with connect(address.replace("http", "ws", 1) + "/v1/stream", proxy=None, open_timeout=300.0) as stream:
            for message in ({"type": "open", "paced": False}, {"type": "word", "gloss": WORDS[0]}, {"type": "end"}):
                stream.send(json.dumps(message))
            while '"done"' not in str(stream.recv(timeout=300.0)):
                pass
        time.sleep(_LINGER_S)


# --- the watch


def watched(calls: Sequence[Sequence[str]], work: Path, switch: str | None = None) -> Seen:
    """What calls do beside their work, which is in the folder ``work``. ``switch``: the telemetry's own, if set."""
    for name in ("home", "tmp", "hook"):
        (work / ".watch" / name).mkdir(parents=True, exist_ok=True)
    (work / ".watch" / "hook" / "sitecustomize.py").write_text(_HOOK)
    script = [sys.executable, str(Path(__file__)), "--watch", str(work), json.dumps([list(call) for call in calls])]
    environment = {key: value for key, value in os.environ.items() if key != _SWITCH}
    environment |= {"PYTHONDONTWRITEBYTECODE": "1"} | ({} if switch is None else {_SWITCH: switch})
    own_user = [] if os.geteuid() == 0 else ["--map-root-user"]
    for kinds, how in ((["--net", "--mount"], "network, disk"), ([], "audit hook, home")):
        prefix = ["unshare", *own_user, *kinds] if kinds else []
        if prefix and not _runs([*prefix, "true"]):
            continue
        run = subprocess.run([*prefix, *script, how], env=environment, capture_output=True, text=True, check=False)
        if run.returncode:
            raise RuntimeError(run.stderr[-2000:])
        return Seen(**json.loads(run.stdout.splitlines()[-1]))
    raise AssertionError


def _runs(call: list[str]) -> bool:
    return shutil.which(call[0]) is not None and not subprocess.run(call, capture_output=True, check=False).returncode


def _watch(work: Path, calls: list[list[str]], how: str) -> Seen:
    """Run calls and watch them, in the namespaces that ``watched`` made."""
    seen, own, names = Seen(how=how), work / ".watch", list[str]()
    top: Path | None = None
    if how.startswith("network"):
        _open_loopback()
        _answer_names(names, own)
        top = _overlaid(own, work)
        seen.how = "network, disk" if top else "network, home"
    environment = os.environ | {
        "HOME": str(own / "home"),
        "TMPDIR": str(own / "tmp"),
        "PYTHONPATH": os.pathsep.join(map(str, (own / "hook", *SOURCES))),
        _WATCHED + "_BY": seen.how,
        _WATCHED: f"{own / 'log'}{os.pathsep}{work}",
        "OMP_NUM_THREADS": "1",
    }
    for name in ("XDG_CACHE_HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME"):
        environment.pop(name, None)
    before = _no_routes()

    def enter() -> None:
        if top is not None:
            os.chroot(top)
        os.chdir(work)

    for call in calls:
        run = subprocess.run(
            call,
            env=environment,
            preexec_fn=enter,
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
            check=False,
        )
        seen.status, seen.errors = run.returncode, run.stderr[-2000:]
        if run.returncode:
            break
    time.sleep(0.5)
    seen.sockets, seen.names = _no_routes() - before, names
    files = {path for name in ("home", "tmp") for path in (own / name).rglob("*") if not path.is_dir()}
    seen.files = [str(path).replace(f"{own}/home", "~").replace(f"{own}/tmp", "$TMPDIR") for path in sorted(files)]
    if top is not None:
        upper = top.parent / "upper"
        seen.files += [f"/{path.relative_to(upper)}" for path in sorted(upper.rglob("*")) if not path.is_dir()]
    with suppress(FileNotFoundError):
        for line in (own / "log").read_text().splitlines():
            kind, _, what = line.partition(" ")
            if kind == "file" and what not in seen.files and Path(what).exists():
                seen.files.append(what)
            elif kind == "name" and what not in seen.names:
                seen.names.append(what)
            elif kind == "socket" and top is None and not how.startswith("network"):
                seen.sockets += 1
    return seen


def _open_loopback() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        up = struct.pack("16sh14x", b"lo", 0x1 | 0x40)  # IFF_UP, IFF_RUNNING
        fcntl.ioctl(any_socket, 0x8914, up)  # SIOCSIFFLAGS


def _answer_names(names: list[str], own: Path) -> None:
    """Answer every look-up with ``_ADDRESS`` and note its name."""
    (own / "resolv.conf").write_text("nameserver 127.0.0.1\noptions timeout:1 attempts:2\n")
    subprocess.run(["mount", "--bind", str(own / "resolv.conf"), "/etc/resolv.conf"], check=True)
    server = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    server.bind(("127.0.0.1", 53))

    def answer() -> None:
        while True:
            query, client = server.recvfrom(4096)
            labels, at = [], 12
            while query[at]:
                labels.append(query[at + 1 : at + 1 + query[at]].decode("latin-1"))
                at += 1 + query[at]
            names.append(".".join(labels))
            question = query[12 : at + 5]
            is_v4 = query[at + 1 : at + 3] == b"\0\1"
            head = query[:2] + b"\x81\x80\0\1" + (b"\0\1" if is_v4 else b"\0\0") + bytes(4)
            record = b"\xc0\x0c\0\1\0\1\0\0\0\1\0\4" + socket.inet_aton(_ADDRESS) if is_v4 else b""
            server.sendto(head + question + record, client)

    threading.Thread(target=answer, daemon=True).start()


def _overlaid(own: Path, work: Path) -> Path | None:
    """A root folder above this one in which whatever is written goes into the folder ``upper`` beside it; the working
    folder and the devices are this system's own. None where no such thing can be mounted.
    """
    layers = own / "layers"
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
        mount("--bind", str(own / "resolv.conf"), f"{layers / 'top'}/etc/resolv.conf")
    except subprocess.CalledProcessError:
        return None
    return layers / "top"


def _no_routes() -> int:
    """How often something in this network wanted to reach an address to which no way leads."""
    four = [line.split()[1:] for line in Path("/proc/net/snmp").read_text().splitlines() if line.startswith("Ip: ")]
    n = int(dict(zip(*four, strict=True))["OutNoRoutes"])
    with suppress(FileNotFoundError):  # no IPv6
        six = re.search(r"^Ip6OutNoRoutes\s+(\d+)", Path("/proc/net/snmp6").read_text(), re.MULTILINE)
        n += int(six[1]) if six else 0
    return n


def tried(name: str, folder: Path, switch: str | None = None) -> Seen:
    """A row of ``COMMANDS``, in an empty folder. ``switch``: as of ``watched``."""
    from signsplice.formats import save

    with open_shipped_lexicon() as words:
        for file, gloss in (("a.bvh", "HELLO"), ("b.bvh", "SIGN"), ("a.glb", "HELLO")):
            save(words.clip(gloss), folder / file)
    return watched(COMMANDS[name], folder, switch)


def main() -> None:
    """Try the commands named, or all; print a row for each. Exit status 1 where something went out or was left."""
    if sys.argv[1:2] == ["--requests"]:
        _ask_a_service()
        return
    if sys.argv[1:2] == ["--watch"]:
        print(json.dumps(asdict(_watch(Path(sys.argv[2]), json.loads(sys.argv[3]), sys.argv[4]))))
        return
    print("| command | exit status | sockets | look-ups | foreign files | watched by |")
    print("| --- | --- | --- | --- | --- | --- |", flush=True)
    n_bad = 0
    for name in sys.argv[1:] or COMMANDS:
        with tempfile.TemporaryDirectory(prefix="ss-", ignore_cleanup_errors=True) as folder:
            seen = tried(name, Path(folder))
        print(f"| {name} | {seen.row()} |", flush=True)
        n_bad += name != "control" and not (seen.is_clean and seen.status == 0)
        if seen.status:
            print(seen.errors, file=sys.stderr)
    sys.exit(n_bad > 0)


if __name__ == "__main__":
    main()
