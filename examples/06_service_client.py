"""Talks to the service: a sentence by one request, and the frames of a stream over a WebSocket.

Run: python examples/06_service_client.py [FOLDER [URL]]     (writes FOLDER/service.bvh and FOLDER/service_stream.npz)
`signsplice serve` (extra serve) has to run, in another terminal; URL is the address that it prints. The requests need
the standard library and websockets; signsplice only saves the stream as a file.
"""

import base64
import json
import sys
from pathlib import Path
from urllib.request import Request, urlopen

import numpy as np
from websockets.sync.client import connect

import signsplice as ss


def request_sentence(url: str, file: Path) -> None:
    """Ask for a sentence as a file."""
    wish = json.dumps({"glosses": ["MY", "NAME", "fs-ANNA"], "formats": ["bvh"]}).encode()
    with urlopen(Request(f"{url}v1/sentence", wish, {"Content-Type": "application/json"})) as answer:
        spliced = json.load(answer)
    # Beside the files come the report, and how each gloss was read.
    file.write_bytes(base64.b64decode(spliced["files"]["bvh"]))
    print(f"{spliced['name']}: {spliced['report']['frames']} frames; wrote {file}")


def stream(url: str, file: Path) -> None:
    """Send words one by one, and collect the frames that come back."""
    with connect(f"{url.replace('http', 'ws', 1)}v1/stream", max_size=None) as socket:
        # A player leaves "paced" out: each frame then comes when it is due. Here all come as soon as they are made.
        words = [{"type": "word", "gloss": gloss} for gloss in ("HELLO", "I", "SIGN")]
        for message in ({"type": "open", "paced": False}, *words, {"type": "end"}):
            socket.send(json.dumps(message))
        answers = list(socket)  # until the service closes the socket; a player would show frames as they come
    texts = [json.loads(answer) for answer in answers if isinstance(answer, str)]
    rig = next(text for text in texts if text["type"] == "skeleton")

    # A binary message: "SSF1", number of its first frame, of frames F, of joints J; then F x (3 + 4 J) float32.
    numbers = [np.frombuffer(answer, "<f4", offset=16) for answer in answers if isinstance(answer, bytes)]
    frames = np.concatenate(numbers).astype(float).reshape(-1, 3 + 4 * len(rig["names"]))
    roots, rotations = frames[:, :3], frames[:, 3:].reshape(len(frames), -1, 4)  # (T, 3), and (T, J, 4) as x y z w
    skeleton = ss.Skeleton(rig["names"], rig["parents"], np.array(rig["offsets"]))
    ss.save(ss.Clip(skeleton, rotations, roots, rig["fps"]), file)
    print(f"{' '.join(text['type'] for text in texts)}: {len(frames)} frames; wrote {file}")


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/examples")
    folder.mkdir(parents=True, exist_ok=True)
    address = sys.argv[2] if len(sys.argv) > 2 else "http://127.0.0.1:8000/"
    request_sentence(address, folder / "service.bvh")
    stream(address, folder / "service_stream.npz")
