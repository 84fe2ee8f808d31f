#!/usr/bin/env bash
# Everything that research/runs/paper.sh does, in minutes: few words, systems of a few thousand weights, a few steps each.
# It checks that all steps run; its figures mean nothing. Leaves everything in out/smoke.
set -euo pipefail
cd "$(dirname "$0")/../.."

SMOKE=${SMOKE:-out/smoke}
mkdir -p "$SMOKE"
[ -x .venv/bin/signsplice-paper ] || make .venv/.dev
made() { [ -f "$SMOKE/$1/corpus.json" ] || .venv/bin/signsplice synth pairs --truth events -o "$SMOKE/$1" "${@:2}"; }
made judged --words 10
made taught --words 8 --teach 3
SCALE=smoke LIMIT=12 PAIRS="$SMOKE/judged" TAUGHT="$SMOKE/taught" BUNDLES="$SMOKE/bundles" OUT="$SMOKE/paper" \
    research/runs/paper.sh "$@"
