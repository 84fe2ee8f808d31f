#!/usr/bin/env bash
# Reproduces the paper from nothing: environment, corpus, trainings, evaluation, tables, figures.
#
#   runs/paper.sh                  scale cpu: small systems, hours on two cores
#   SCALE=paper runs/paper.sh      the paper's sizes; needs a GPU
#
# The same call continues after an interruption: what is generated, trained or evaluated already is kept.
set -euo pipefail
cd "$(dirname "$0")/.."

SCALE=${SCALE:-cpu}
PYTHON=${PYTHON:-python3}
PAIRS=${PAIRS:-out/pairs}
BUNDLES=${BUNDLES:-out/bundles}
OUT=${OUT:-docs/paper}
if [ "$SCALE" = paper ]; then WORKERS=${WORKERS:-1}; else WORKERS=${WORKERS:-$(nproc)}; fi  # one GPU, or many cores
BIN=.venv/bin

[ -x "$BIN/python" ] || "$PYTHON" -m venv .venv
"$BIN/python" -c 'import torch, matplotlib, signsplice' 2>/dev/null ||
    "$BIN/python" -m pip install --quiet --disable-pip-version-check --editable '.[train,paper]'

[ -f "$PAIRS/corpus.json" ] || "$BIN/signsplice" synth pairs -o "$PAIRS"
"$BIN/signsplice" paper all --scale "$SCALE" --workers "$WORKERS" --pairs "$PAIRS" --bundles "$BUNDLES" --out "$OUT" "$@"
