#!/usr/bin/env bash
# Tests swath against programs that others wrote: MCAP and ROS 2 readers, and a zenoh peer.
# Usage: run.sh [SWATH_BINARY]; without one the release build is used, and made if need be.
set -euo pipefail
export PYTHONDONTWRITEBYTECODE=1

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
root=$(cd "$here/../.." && pwd)
cd "$root"

python=$root/.venv/bin/python
if ! cmp -s "$here/requirements.txt" .venv/installed.txt; then
    python3 -m venv --clear .venv
    "$python" -m pip install --quiet --disable-pip-version-check --requirement "$here/requirements.txt"
    cp "$here/requirements.txt" .venv/installed.txt
fi

# The whole workspace is named so that its dependencies are those that other builds made already.
cargo build --release --workspace --bins --example every_message --example logits
target=${CARGO_TARGET_DIR:-$root/target}
swath=${1:-$target/release/swath}

scratch=$(mktemp -d)
planner=
finish() {
    if [[ -n $planner ]]; then
        kill "$planner" 2>/dev/null || true
        wait "$planner" 2>/dev/null || true
    fi
    rm -rf "$scratch"
}
trap finish EXIT

"$target/release/examples/every_message" "$scratch/every.mcap" "$scratch/every.json"
"$python" "$here/check_recording.py" "$scratch/every.mcap" "$scratch/every.json" bridge/msg
"$python" "$here/compare_readers.py" "$scratch/every.mcap"

"$swath" export --onnx "$scratch/network.onnx"
mkdir "$scratch/logits"
"$target/release/examples/logits" trainer/weights/enet-shared-half.safetensors "$scratch/logits"
"$python" "$here/compare_onnx.py" "$scratch/network.onnx" "$scratch/logits"

# The example makes the network's inputs by itself, from a picture and from a recording.
for seed in 1 2 3; do
    scene=$scratch/scene-$seed
    mkdir "$scene"
    "$python" "$here/scene.py" "$scene" "$seed"
    # Regions come before the searches, which may solve nothing in so little time.
    "$swath" plan --map "$scene/map.pgm" --goals "$scene/goals.txt" --reference "$scene/reference.txt" \
        --method tiev-fcn --time-limit-ms 100 --regions "$scene/regions.npy" >/dev/null || test $? = 4
    regions=("$python" examples/python/onnx_regions.py "$scratch/network.onnx" --expect "$scene/regions.npy")
    "${regions[@]}" --map "$scene/map.pgm" --goals "$scene/goals.txt" --reference "$scene/reference.txt" | tail -n 1
    "${regions[@]}" --recording "$scene/frame.mcap" --vehicle car-1 | tail -n 1
done

port=$("$python" -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')
"$swath" --listen "tcp/127.0.0.1:$port" plan --vehicle interop >"$scratch/planner.log" 2>&1 &
planner=$!
if ! "$python" "$here/plan_with_planner.py" "tcp/127.0.0.1:$port" bridge/msg interop; then
    cat "$scratch/planner.log" >&2
    exit 1
fi
echo "interop: all passed"
