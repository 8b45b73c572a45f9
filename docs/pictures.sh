#!/usr/bin/env bash
# Makes the pictures of the README and of docs/VIEW.md: bakes a scene in the light of a sun and a sky, as a draft, renders it, and
# takes screenshots of `lightkiln view`.
#
#   docs/pictures.sh [FOLDER WITH REAL SCENES]
set -euo pipefail
cd "$(dirname "$0")/.."
scenes=${1:-../shared/scenes}
lightkiln=${LIGHTKILN:-target/release/lightkiln}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

if [ ! -f "$scenes/toy_car.glb" ]; then
  echo "$scenes/toy_car.glb is not there: the pictures stay as they are" >&2
  exit
fi
# A bound that a draft does not keep (6) is said in the report.
"$lightkiln" bake "$scenes/toy_car.glb" -o "$work/toy_car.glb" --quiet --quality draft --signal lightmap --sun 60,35,60000 \
  --sky 12000 --report "$work/toy_car.json" || test $? = 6
"$lightkiln" render "$work/toy_car.glb" -o docs/readme.png --quiet --size 480x330 --rays 128 --view 35,22 --zoom 2.6 \
  --target=0,0.006,0 --columns 2 --mode shaded,reference,point,light
node docs/view.mjs "$work/toy_car.glb" "$work/toy_car.json" docs
