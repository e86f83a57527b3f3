#!/bin/sh
# Makes the weights that come with swath, as their model card says: data, training, evaluation.
#
#   trainer/weights/make.sh LOGS FOLDER
#
# LOGS holds the Radish logs as MCAP files; FOLDER takes the samples (250 MB) and the run. Two cores need
# about two hours. Started again, it goes on where it was.
set -eu

logs=$1
folder=$2
mkdir -p "$folder"
cargo build --release --workspace --bins
swath=${CARGO_TARGET_DIR:-target}/release/swath

generate() {
    file=$folder/$1.mcap
    shift
    [ -f "$file" ] || { "$swath" generate "$@" --out "$file.part" && mv "$file.part" "$file"; }
}

generate a --count 15000 --seed 1
generate b --count 48000 --seed 2
generate c --count 48000 --seed 3
generate r --count 10000 --seed 4 \
    --log "$logs/radish_freiburg_campus.mcap" --log "$logs/radish_csail.mcap" \
    --log "$logs/radish_fhw.mcap" --log "$logs/radish_freiburg_101.mcap" \
    --log "$logs/radish_intel.mcap"
generate validation --count 2300 --seed 900001
generate held-out --count 2300 --seed 900002

resume=
[ ! -f "$folder/run/checkpoint.safetensors" ] || resume=--resume
"$swath" train --data "$folder/a.mcap:6" --data "$folder/b.mcap" --data "$folder/c.mcap" \
    --data "$folder/r.mcap" --aside 2000 --split random --validation "$folder/validation.mcap" \
    --epochs 2 --score-every 2000 --out "$folder/run" $resume

weights=$folder/run/weights.safetensors
"$swath" evaluate --weights "$weights" --data "$folder/held-out.mcap"
"$swath" evaluate --weights "$weights" --data "$folder/held-out.mcap" --dilation-m 2
"$swath" evaluate --weights "$weights" --data "$folder/a.mcap" --aside 2000 --split random
