#!/usr/bin/env bash
# The wheel of out/dist, installed and used in a clean environment on every Python from 3.11 to 3.13 that is found here.
# Prints a line for each; ends with 1 where one fails. Needs an index of packages, as pip does.
set -euo pipefail
cd "$(dirname "$0")/../.."

wheel=$(ls -t out/dist/signsplice-*.whl | head -1)
place=$(mktemp -d)
trap 'rm -rf "$place"' EXIT
failed=0

use() { # install and use the wheel with the Python $1, away from the source tree
    local bin="$place/$1/bin"
    "$1" -m venv "$place/$1"
    "$bin/python" -m pip install --quiet --disable-pip-version-check "$OLDPWD/$wheel[serve,video]"
    "$bin/signsplice" --version
    "$bin/signsplice" demo --out "$place/$1/demo"
    "$bin/signsplice" sentence "HELLO MY NAME fs-ANNA" -o "$place/$1/anna.vrma"
    "$bin/signsplice" view "$place/$1/anna.vrma" -o "$place/$1/anna.html"
    "$bin/signsplice" splice "$place/$1"/demo/words/{HELLO,DEAF}.bvh -o "$place/$1/ab.glb" --report "$place/$1/ab.json"
    "$bin/python" - "$place/$1" <<'PYTHON'
import sys
import signsplice as ss

clips = [ss.load(f"{sys.argv[1]}/demo/words/{word}.bvh") for word in ("HELLO", "DEAF")]
assert ss.splice(clips).clip.skeleton is clips[0].skeleton
assert sum(len(piece.clip) for piece in ss.stream(clips)) > 60
PYTHON
}

for name in python3.11 python3.12 python3.13; do
    if ! "$name" -c '' 2>/dev/null; then
        echo "$name: not found here"
    elif (cd "$place" && use "$name") >"$place/log" 2>&1; then
        echo "$name: $("$name" -c 'import platform; print(platform.python_version(), platform.system())') works"
    else
        echo "$name: failed"
        tail -20 "$place/log"
        failed=1
    fi
done
exit $failed
