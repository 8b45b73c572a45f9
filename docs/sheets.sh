#!/usr/bin/env bash
# Makes the picture sheets of docs/sheets: bakes each scene at normal quality and renders, side by side: reference, point sampling at vertices, least squares at vertices, classes, hybrid as
# the file shows it, and ten times its error.
#
#   docs/sheets.sh [FOLDER WITH REAL SCENES]
set -euo pipefail
cd "$(dirname "$0")/.."
scenes=${1:-../shared/scenes}
lightkiln=target/release/lightkiln
props=target/release/lightkiln-props
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

sheet() { # scene file, name, view, zoom
  "$lightkiln" bake "$1" -o "$work/$2.glb" --quiet
  "$lightkiln" render "$work/$2.glb" -o "docs/sheets/$2.png" --quiet --size 320 --rays 256 --view "$3" --zoom "$4" \
    --mode reference,point,least-squares,classes,light,error
}

"$props" seat -o "$work/seat_in.glb"
sheet "$work/seat_in.glb" seat 35,15 1
"$props" car --size 150000 -o "$work/car_in.glb"
sheet "$work/car_in.glb" car 35,20 1

while read -r file view zoom; do
  if [ -f "$scenes/$file.glb" ]; then
    sheet "$scenes/$file.glb" "$file" "$view" "$zoom"
  else
    echo "$scenes/$file.glb is not there: its sheet stays as it is" >&2
  fi
done <<'SCENES'
sheen_chair 35,20 1
flight_helmet 20,10 1
toy_car 35,25 1
antique_camera -40,15 1
lamborghini_huracan 35,20 1
dream_apartment 35,50 1.2
SCENES
