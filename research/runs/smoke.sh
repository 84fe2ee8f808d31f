#!/usr/bin/env bash
# Everything that research/runs/paper.sh does, in minutes: ten words, systems of a few thousand weights, a few steps each.
# It checks that all steps run; its figures mean nothing. Leaves everything in out/smoke.
set -euo pipefail
cd "$(dirname "$0")/../.."

SMOKE=${SMOKE:-out/smoke}
mkdir -p "$SMOKE"
if [ ! -f "$SMOKE/pairs/corpus.json" ]; then
    [ -x .venv/bin/signsplice-paper ] || make .venv/.dev
    .venv/bin/signsplice synth pairs -o "$SMOKE/pairs" --words 10 --other-signer 10
fi
SCALE=smoke PAIRS="$SMOKE/pairs" BUNDLES="$SMOKE/bundles" OUT="$SMOKE/paper" research/runs/paper.sh --limit 50 "$@"
