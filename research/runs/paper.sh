#!/usr/bin/env bash
# Reproduces the paper from nothing: environment, corpus, trainings, evaluation, tables, figures.
#
#   research/runs/paper.sh                  scale cpu: small systems, hours on two cores
#   research/runs/paper.sh --minutes 60     train for an hour; tables of what is there
#   TRUTH=word research/runs/paper.sh       on the corpus whose cuts do not depend on the partner, into research/docs/word
#   SCALE=paper research/runs/paper.sh      the paper's sizes; needs a GPU (research/runs/paper-scale.sh: in pieces)
#
# The same call continues after an interruption: what is generated, trained or evaluated already is kept.
set -euo pipefail
cd "$(dirname "$0")/../.."

SCALE=${SCALE:-cpu}
PYTHON=${PYTHON:-python3}
TRUTH=${TRUTH:-partner}
if [ "$TRUTH" = partner ]; then OF='' PAGES=research/docs; else OF=-$TRUTH PAGES=research/docs/$TRUTH; fi
PAIRS=${PAIRS:-out/pairs$OF}
BUNDLES=${BUNDLES:-out/bundles$OF}
OUT=${OUT:-$PAGES}
if [ "$SCALE" = paper ]; then WORKERS=${WORKERS:-1}; else WORKERS=${WORKERS:-$(nproc)}; fi  # one GPU, or many cores
BIN=.venv/bin

[ -x "$BIN/python" ] || "$PYTHON" -m venv .venv
"$BIN/python" -c 'import torch, signsplice_paper' 2>/dev/null ||
    "$BIN/python" -m pip install --quiet --disable-pip-version-check --editable . --editable './workshop[train]' --editable ./research

[ -f "$PAIRS/corpus.json" ] || "$BIN/signsplice" synth pairs -o "$PAIRS" --truth "$TRUTH"
"$BIN/signsplice-paper" all --scale "$SCALE" --workers "$WORKERS" --pairs "$PAIRS" --bundles "$BUNDLES" --out "$OUT" "$@"
