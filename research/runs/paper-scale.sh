#!/usr/bin/env bash
# Trains the paper's systems at the paper's sizes on one GPU, by AdamW and by SGD, judges them there, and leaves rows
# and bundles: OUT/paper (results.json, frames.npz, tables) and OUT/bundles.
#
#   OUT=out/paper-scale research/runs/paper-scale.sh             a piece of ten minutes; call it until it says "done"
#   FROM=out/first OUT=out/second research/runs/paper-scale.sh   the next piece elsewhere, from what an earlier one left
#   SCALE=smoke PIECE=20 research/runs/paper-scale.sh            the same in minutes, on a processor
#
# Every call stops by itself before PIECE seconds are over. A call that is killed loses at most two minutes of training,
# or one row of judging. It needs a Python with torch, onnx, onnxscript, onnxruntime, filelock, scipy and click; the
# packages themselves are taken from src and research/src, so that a copy of these files is enough. A copy without its
# repository can say which commit it is of: SIGNSPLICE_COMMIT. Afterwards `signsplice-paper merge --from OUT/paper` adds
# the rows.
set -euo pipefail
cd "$(dirname "$0")/../.."

SCALE=${SCALE:-paper}
OUT=${OUT:-out/paper-scale}
PAIRS=${PAIRS:-$OUT/pairs}
PIECE=${PIECE:-570}           # seconds
MARGIN=${MARGIN:-60}          # seconds kept for exporting what was trained last
WORKERS=${WORKERS:-3}         # trainings at once on the GPU: the small networks leave most of it idle
JUDGES=${JUDGES:-$(( $(nproc) > 1 ? $(nproc) / 2 : 1 ))}  # processes that judge, each with one thread
SYSTEMS=${SYSTEMS:-"lptransformer lptransformer-printed lpt-plus transformer lstm conv-s2s"}
OPTIMISERS=${OPTIMISERS:-"adamw sgd"}
SPLITS=${SPLITS:-"random unseen-words unseen-signer unseen-both"}
LIMIT=${LIMIT:-}              # pairs of a split that are judged, all by default
STEPS=${STEPS:-}              # steps of every part, in place of the scale's
PYTHON=${PYTHON:-$([ -x .venv/bin/python ] && echo .venv/bin/python || echo python3)}
export PYTHONPATH="$PWD/src:$PWD/research/src${PYTHONPATH:+:$PYTHONPATH}"

paper() { "$PYTHON" -m signsplice_paper "$@"; }
left() { echo $(( PIECE - SECONDS )); }
again() { echo "$1; call again to continue"; exit 0; }

"$PYTHON" -c 'import torch, onnx, onnxscript, onnxruntime, filelock, scipy, click; print("torch", torch.__version__,
    torch.cuda.get_device_name() if torch.cuda.is_available() else "on the processor")'
mkdir -p "$OUT"
for name in pairs judged bundles; do
    if [ -n "${FROM:-}" ] && [ -e "$FROM/$name" ] && [ ! -e "$OUT/$name" ]; then
        rm -rf "$OUT/.$name" && cp -R "$FROM/$name" "$OUT/.$name" && mv "$OUT/.$name" "$OUT/$name"
    fi
done
if [ ! -f "$PAIRS/corpus.json" ]; then
    timeout "$(left)" "$PYTHON" -m signsplice synth pairs --truth events -o "$PAIRS" || again "the corpus is not made yet"
fi

chosen=()
for system in $SYSTEMS; do chosen+=(--system "$system"); done
for optimiser in $OPTIMISERS; do chosen+=(--optimiser "$optimiser"); done
chosen+=(--scale "$SCALE" --pairs "$PAIRS" --bundles "$OUT/bundles" --split random --seed 0)

# Training: the last piece may have ended between a training and its bundle, which this call then writes first.
minutes=$(awk "BEGIN { print ($(left) - $MARGIN > 0 ? $(left) - $MARGIN : 0) / 60 }")
paper train "${chosen[@]}" --workers "$WORKERS" --minutes "$minutes" ${STEPS:+--steps "$STEPS"} || exit
missing=0
for system in $SYSTEMS; do
    for optimiser in $OPTIMISERS; do
        [ -f "$OUT/bundles/$system-$SCALE-$optimiser-random/bundle.json" ] || missing=$(( missing + 1 ))
    done
done
[ "$missing" -eq 0 ] || again "$missing systems are not trained yet"

# Judging: a process for each system and split; rows that are there are not judged again.
judge() {
    [ "$(( PIECE - SECONDS ))" -gt 5 ] || exit 1
    mkdir -p "$OUT/judged/$1-$2"
    OMP_NUM_THREADS=1 timeout "$(( PIECE - SECONDS ))" "$PYTHON" -m signsplice_paper judge \
        --scale "$SCALE" --pairs "$PAIRS" --bundles "$OUT/bundles" --out "$OUT/judged/$1-$2" --system "$1" --seed 0 --split "$2" \
        ${LIMIT:+--limit "$LIMIT"} > "$OUT/judged/$1-$2/log.txt" 2>&1 && touch "$OUT/judged/$1-$2/done"
}
rm -f "$OUT"/judged/*/done
for system in $SYSTEMS; do
    for split in $SPLITS; do
        while [ "$(jobs -pr | wc -l)" -ge "$JUDGES" ]; do wait -n || true; done
        judge "$system" "$split" &
    done
done
wait
for system in $SYSTEMS; do
    for split in $SPLITS; do
        [ -f "$OUT/judged/$system-$split/done" ] && continue
        tail -n 1 "$OUT/judged/$system-$split/log.txt" 2>/dev/null || true
        again "$system is not judged yet on $split"
    done
done

from=()
for folder in "$OUT"/judged/*/; do from+=(--from "$folder"); done
paper merge "${from[@]}" --scale "$SCALE" --out "$OUT/paper"
du -sh "$OUT"/bundles/*/ | sort -k2
echo "done: rows and tables in $OUT/paper, bundles in $OUT/bundles"
