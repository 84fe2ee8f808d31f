#!/usr/bin/env bash
# Reproduces the paper from nothing: environment, corpora, trainings, evaluation, table, figures.
#
#   research/runs/paper.sh                  scale cpu: small systems, hours on two cores
#   research/runs/paper.sh --minutes 60     train for an hour; tables of what is there
#   SCALE=paper research/runs/paper.sh      the paper's sizes; needs a GPU (research/runs/paper-scale.sh: in pieces)
#
# The same call continues after an interruption: what is generated, trained or evaluated already is kept.
set -euo pipefail
cd "$(dirname "$0")/../.."

SCALE=${SCALE:-cpu}
PYTHON=${PYTHON:-python3}
PAIRS=${PAIRS:-out/judged}       # pairs of 100 words by one signer, and the tests
TAUGHT=${TAUGHT:-out/taught}     # pseudo-signs of many signers, to teach on
SIGNERS=${SIGNERS:-64}
LIMIT=${LIMIT:-}                 # pairs of a split that are judged, all by default
BUNDLES=${BUNDLES:-out/bundles}
OUT=${OUT:-research/docs}
if [ "$SCALE" = paper ]; then WORKERS=${WORKERS:-1}; else WORKERS=${WORKERS:-$(nproc)}; fi  # one GPU, or many cores
BIN=.venv/bin

[ -x "$BIN/python" ] || "$PYTHON" -m venv .venv
"$BIN/python" -c 'import torch, signsplice_paper' 2>/dev/null ||
    "$BIN/python" -m pip install --quiet --disable-pip-version-check --editable . --editable './workshop[train]' --editable ./research

[ -f "$PAIRS/corpus.json" ] || "$BIN/signsplice" synth pairs --truth events -o "$PAIRS"
[ -f "$TAUGHT/corpus.json" ] || "$BIN/signsplice" synth pairs --truth events --teach "$SIGNERS" -o "$TAUGHT"
"$BIN/signsplice-paper" train --scale "$SCALE" --workers "$WORKERS" --pairs "$TAUGHT" --bundles "$BUNDLES" "$@"
"$BIN/signsplice-paper" all --scale "$SCALE" --workers "$WORKERS" --pairs "$PAIRS" --bundles "$BUNDLES" --out "$OUT" \
    ${LIMIT:+--limit "$LIMIT"} "$@"
