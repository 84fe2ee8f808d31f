"""Outputs that are devices, pipes, links or inputs, and full disks: ``python attacks/outputs.py``.

A table row for each attack goes to standard output. Takes about ten seconds. Making a device and mounting a small disk
need root; without it those attacks are left out.
"""

from __future__ import annotations

import os
import shutil
import socket
import stat
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from kills import Writer, command, commands, content, ended, forked, silenced


def said(call: Callable[[], object]) -> tuple[int, str]:
    """Exit status of a call and what it writes to standard error."""
    with tempfile.TemporaryFile("w+") as errors:

        def redirected() -> None:
            os.dup2(errors.fileno(), 2)
            sys.stderr = os.fdopen(2, "w")
            status = call()
            sys.stderr.flush()
            os._exit(status if isinstance(status, int) else 0)

        status = ended(forked(redirected))
        errors.seek(0)
        return status, errors.read().strip()


def misdirected(inputs: Path, folder: Path) -> Iterator[tuple[str, str]]:
    """Attack and what was seen, of outputs that are devices, pipes, links or inputs."""
    one, two = (str(path) for path in sorted((inputs / "clips").glob("*.bvh"))[:2])
    os.mkfifo(folder / "pipe.bvh")
    with socket.socket(socket.AF_UNIX) as listener:
        os.chdir(folder)
        listener.bind("socket.bvh")
    (folder / "link.bvh").symlink_to("own.bvh")
    shutil.copy(one, folder / "own.bvh")
    os.link(folder / "own.bvh", folder / "same.bvh")
    names = ["pipe.bvh", "socket.bvh", "link.bvh", "own.bvh", "same.bvh", "own.bvh as --report"]
    try:
        os.mknod(folder / "null.bvh", stat.S_IFCHR | 0o666, os.makedev(1, 3))
        names += ["null.bvh", "null.bvh as --report"]
    except PermissionError:
        pass
    for name in names:
        path = folder / name.split()[0]
        before = (path.lstat().st_ino, path.lstat().st_mode, (folder / "own.bvh").read_bytes())
        out = ("-o", "out.bvh", "--report", path.name) if name.endswith("--report") else ("-o", path.name)
        status, line = said(lambda out=out: command(folder, "splice", "own.bvh", two, *out))  # type: ignore[misc]
        after = (path.lstat().st_ino, path.lstat().st_mode, (folder / "own.bvh").read_bytes())
        kept = "untouched" if after == before and not (folder / "out.bvh").exists() else "CHANGED"
        yield f"`splice own.bvh ... -o` {name}", f"exit {status}, {kept}: `{line}`"
    os.link(shutil.copy(one, folder / "far.bvh"), folder / "near.bvh")
    status, line = said(lambda: command(folder, "splice", "own.bvh", two, "-o", "near.bvh"))
    kept = "the other name untouched" if (folder / "far.bvh").read_bytes() == Path(one).read_bytes() else "CHANGED"
    yield "`splice own.bvh ... -o` near.bvh, a hard link to far.bvh", f"exit {status}, {kept}: `{line}`"


@contextmanager
def full_disk(folder: Path, n_free: int) -> Iterator[Path]:
    """A small disk with ``n_free`` bytes left. Raises ``CalledProcessError`` without the right to mount one."""
    folder.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "none", str(folder)], check=True, capture_output=True)
    try:
        yield folder
    finally:
        os.chdir("/")
        subprocess.run(["umount", str(folder)], check=False)


def on_full_disks(writers: list[Writer], folder: Path) -> Iterator[tuple[str, str]]:
    """Attack and what was seen, of every writer on a disk with 24 kB left."""
    for number, writer in enumerate(writers):
        with full_disk(folder / f"disk-{number}", 24_000) as disk:
            writer.prepare(disk)
            old = content(disk)
            left = os.statvfs(disk)
            (disk / "filler").write_bytes(bytes(max(0, left.f_bavail * left.f_frsize - 24_000)))
            status, line = said(lambda writer=writer, disk=disk: reported(writer, disk))  # type: ignore[misc]
            found = {name: files for name, files in content(disk).items() if name != "filler"}
            over = sorted(name for name in os.listdir(disk) if name.startswith("."))
            kept = "old content whole" if found == old else f"CHANGED {sorted(found)}"
            yield f"disk full: {writer.name}", f"exit {status}, {kept}, left over {over or 'nothing'}: `{line}`"


def reported(writer: Writer, folder: Path) -> int:
    """Exit status of a writer; its error goes to standard error, as the command line prints it."""
    try:
        writer.write(folder)
    except SystemExit:
        return 2
    except Exception as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        return 2
    return 0


def main() -> None:
    """Run all attacks and print their rows."""
    print("| attack | seen |\n| --- | --- |", flush=True)
    with tempfile.TemporaryDirectory(prefix="signsplice-outputs-", ignore_cleanup_errors=True) as top:
        folder = Path(top)
        (folder / "inputs").mkdir()
        (folder / "misdirected").mkdir()
        with silenced():
            writers = commands(folder / "inputs")
        for name, seen in misdirected(folder / "inputs", folder / "misdirected"):
            print(f"| {name} | {seen} |".replace(top, ""), flush=True)
        try:
            for name, seen in on_full_disks(writers, folder):
                print(f"| {name} | {seen} |".replace(top, ""), flush=True)
        except subprocess.CalledProcessError as error:
            print(f"| disk full | not tried: {error.stderr.decode().strip()} |", flush=True)
        os.chdir("/")


if __name__ == "__main__":
    main()
