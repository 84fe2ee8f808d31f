"""Writes to devices, pipes, links, inputs and full disks: ``python attacks/outputs.py``.

Prints a table row for each attack. Takes about ten seconds. Making a device and mounting a small disk need root;
without it those attacks are left out.
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

from kills import Writer, fork, make_writers, read_folder, run_command, silence_output, wait_for


def capture(call: Callable[[], object]) -> tuple[int, str]:
    """Returns the exit status of a call and its standard error."""
    with tempfile.TemporaryFile("w+") as error_file:

        def redirect() -> None:
            os.dup2(error_file.fileno(), 2)
            sys.stderr = os.fdopen(2, "w")
            status = call()
            sys.stderr.flush()
            os._exit(status if isinstance(status, int) else 0)

        status = wait_for(fork(redirect))
        error_file.seek(0)
        return status, error_file.read().strip()


def attack_misdirected(inputs: Path, folder: Path) -> Iterator[tuple[str, str]]:
    """Yields attack and result of outputs that are devices, pipes, links or inputs."""
    first, second = (str(path) for path in sorted((inputs / "clips").glob("*.bvh"))[:2])
    os.mkfifo(folder / "pipe.bvh")
    with socket.socket(socket.AF_UNIX) as listener:
        os.chdir(folder)
        listener.bind("socket.bvh")
    (folder / "link.bvh").symlink_to("own.bvh")
    shutil.copy(first, folder / "own.bvh")
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
        options = ("-o", "out.bvh", "--report", path.name) if name.endswith("--report") else ("-o", path.name)
        status, line = capture(lambda options=options: run_command(folder, "splice", "own.bvh", second, *options))  # type: ignore[misc]
        after = (path.lstat().st_ino, path.lstat().st_mode, (folder / "own.bvh").read_bytes())
        verdict = "untouched" if after == before and not (folder / "out.bvh").exists() else "CHANGED"
        yield f"`splice own.bvh ... -o` {name}", f"exit {status}, {verdict}: `{line}`"
    os.link(shutil.copy(first, folder / "far.bvh"), folder / "near.bvh")
    status, line = capture(lambda: run_command(folder, "splice", "own.bvh", second, "-o", "near.bvh"))
    verdict = "the other name untouched" if (folder / "far.bvh").read_bytes() == Path(first).read_bytes() else "CHANGED"
    yield "`splice own.bvh ... -o` near.bvh, a hard link to far.bvh", f"exit {status}, {verdict}: `{line}`"


@contextmanager
def mount_full_disk(folder: Path, n_free: int) -> Iterator[Path]:
    """Mounts a small disk with ``n_free`` bytes left. Raises ``CalledProcessError`` without the right to mount one."""
    folder.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "none", str(folder)], check=True, capture_output=True)
    try:
        yield folder
    finally:
        os.chdir("/")
        subprocess.run(["umount", str(folder)], check=False)


def attack_full_disks(writers: list[Writer], folder: Path) -> Iterator[tuple[str, str]]:
    """Yields attack and result of every writer on a disk with 24 kB left."""
    for number, writer in enumerate(writers):
        with mount_full_disk(folder / f"disk-{number}", 24_000) as disk:
            writer.prepare(disk)
            old = read_folder(disk)
            free_space = os.statvfs(disk)
            (disk / "filler").write_bytes(bytes(max(0, free_space.f_bavail * free_space.f_frsize - 24_000)))
            status, line = capture(lambda writer=writer, disk=disk: report_status(writer, disk))  # type: ignore[misc]
            contents = {name: files for name, files in read_folder(disk).items() if name != "filler"}
            left_over = sorted(name for name in os.listdir(disk) if name.startswith("."))
            verdict = "old content whole" if contents == old else f"CHANGED {sorted(contents)}"
            yield f"disk full: {writer.name}", f"exit {status}, {verdict}, left over {left_over or 'nothing'}: `{line}`"


def report_status(writer: Writer, folder: Path) -> int:
    """Returns the exit status of a writer; prints its error to standard error, as the command line does."""
    try:
        writer.write(folder)
    except SystemExit:
        return 2
    except Exception as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        return 2
    return 0


def main() -> None:
    """Runs all attacks and prints their rows."""
    print("| attack | seen |\n| --- | --- |", flush=True)
    with tempfile.TemporaryDirectory(prefix="signsplice-outputs-", ignore_cleanup_errors=True) as top:
        folder = Path(top)
        (folder / "inputs").mkdir()
        (folder / "misdirected").mkdir()
        with silence_output():
            writers = make_writers(folder / "inputs")
        for name, result in attack_misdirected(folder / "inputs", folder / "misdirected"):
            print(f"| {name} | {result} |".replace(top, ""), flush=True)
        try:
            for name, result in attack_full_disks(writers, folder):
                print(f"| {name} | {result} |".replace(top, ""), flush=True)
        except subprocess.CalledProcessError as error:
            print(f"| disk full | not tried: {error.stderr.decode().strip()} |", flush=True)
        os.chdir("/")


if __name__ == "__main__":
    main()
