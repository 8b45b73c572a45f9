#!/usr/bin/env bash
# Makes the pictures of docs/FAULTS.md: bakes each scene of a fault and renders it close up, traced and as the file shows it.
# Seconds each on two cores.
#
#   docs/faults.sh [FAULT...]
set -euo pipefail
cd "$(dirname "$0")/.."
lightkiln=${LIGHTKILN:-target/release/lightkiln}
props=${LIGHTKILN_PROPS:-target/release/lightkiln-props}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p docs/faults

# A name, a signal, where the eye is in degrees, what it looks at, how close, and options of the bake.
while read -r name signal view target zoom extra; do
  if [ $# -gt 0 ] && [[ " $* " != *" $name "* ]]; then continue; fi
  "$props" "fault_$name" -o "$work/in.glb"
  # A bound that so few samples do not keep (6) is no matter here.
  # shellcheck disable=SC2086 # several options
  "$lightkiln" bake "$work/in.glb" -o "$work/$name.glb" --quiet --signal "$signal" $extra || test $? = 6
  "$lightkiln" render "$work/$name.glb" -o "docs/faults/$name.png" --quiet --size 360 --rays 256 --view="$view" \
    --target="$target" --zoom "$zoom" --mode reference,light
done <<'FAULTS'
back_faces    ao     20,25   0,0.25,0       1.6 --samples 20000 --ao-distance inf
inside        ao     35,35   0,0.05,0       4   --samples 20000 --ao-distance inf
terminator    direct 115,10  0,0,0          1.1 --samples 20000
contact       shadow -150,25 0,0.05,0.2     2.5 --detail 0.02
thin_wall     shadow 35,30   0.15,0.05,0    1.8 --detail 0.02
coincident    ao     25,35   0,0.2,0        1.6 --samples 20000 --ao-distance inf
mirrored      shadow 0,50    0,0.1,0        1.3 --samples 20000
open_shell    ao     15,40   0,-0.15,0      1.2 --samples 20000 --ao-distance inf
FAULTS
