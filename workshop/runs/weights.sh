#!/usr/bin/env bash
# Trains networks of the sizes of those that ship, with today's commands, into out/weights. It cannot make the shipped
# bytes, which came from a history of continued trainings (workshop/docs/training.md), and it does not replace them: the figures
# of its networks have to be measured first. About three hours on two cores. The same call continues after an
# interruption. Arguments go to every `signsplice train`.
set -euo pipefail
cd "$(dirname "$0")/../.."

SIGNING=${SIGNING:-out/signing}       # sentences, for the network that makes transitions
WORDS=${WORDS:-out/words-more}        # many more words, for the network that cuts
OUT=${OUT:-out/weights}
SHIPPED=src/signsplice/splicing/weights
[ -x .venv/bin/signsplice ] || make .venv/.dev
run=.venv/bin/signsplice
export OMP_NUM_THREADS=${OMP_NUM_THREADS:-1}

echo "Training networks of the sizes of those that ship, into $OUT. They will not be the shipped bytes: measure them."
$run synth endless -o "$SIGNING"
$run synth endless --seed 1 --signers 44 --words 250 --seams 0 -o "$WORDS"
$run train cutter --signing "$WORDS" --out "$OUT/cutter" "$@" &
cutter=$!
trap 'kill -TERM $cutter 2>/dev/null || true' EXIT
$run train transition --signing "$SIGNING" --out "$OUT/transition" "$@"
wait $cutter
trap - EXIT
# Both are trained now; these calls find them trained and put them into one bundle.
$run train cutter --signing "$WORDS" --out "$OUT/bundle" "$@"
$run train transition --signing "$SIGNING" --out "$OUT/bundle" "$@"
$run export "$OUT/bundle" -o "$OUT/int8" --int8

cat <<END
$OUT/int8: networks of the sizes of those that ship, made by today's commands. Their figures are not those in the docs.
Measure them:          $run evaluate seams 500 --bundle $OUT/int8     (and clips, pairs: workshop/docs/evaluation.md)
Put them in place:     cp $OUT/int8/* $SHIPPED/
END
