#!/usr/bin/env bash
# Makes the picture sheets of light in docs/sheets: bakes each scene with one command and renders, side by side:
# reference, light as the file shows it, classes, and ten times its error. What is made of paths of light is a draft, which
# takes minutes on two cores. Reports go to a folder, if one is given: docs/light.mjs makes the table of docs/RESULTS.md of them.
#
#   docs/light_sheets.sh [FOLDER WITH REAL SCENES] [FOLDER FOR REPORTS]
set -euo pipefail
cd "$(dirname "$0")/.."
scenes=${1:-../shared/scenes}
lightkiln=${LIGHTKILN:-target/release/lightkiln}
props=${LIGHTKILN_PROPS:-target/release/lightkiln-props}
work=$(mktemp -d)
reports=${2:-$work}
trap 'rm -rf "$work"' EXIT

sheet() { # scene file, name, view, zoom, options of the bake
  local file=$1 name=$2 view=$3 zoom=$4
  shift 4
  if [ ! -f "$file" ]; then
    echo "$file is not there: its sheet stays as it is" >&2
    return
  fi
  # A bound that a draft does not keep (6) is said in the report.
  "$lightkiln" bake "$file" -o "$work/$name.glb" --quiet --report "$reports/$name.json" "$@" || test $? = 6
  "$lightkiln" render "$work/$name.glb" -o "docs/sheets/light_$name.png" --quiet --size 400 --rays 256 --view "$view" \
    --zoom "$zoom" --mode reference,light,classes,error
}

# Schaefer's Table 1 in our own way.
"$props" house --size 199000 -o "$work/house_in.glb"
"$props" car_studio --size 400000 -o "$work/car_in.glb"
"$props" seat --size 160000 -o "$work/seat_in.glb"
"$props" room --size 24 -o "$work/room.glb"
sheet "$work/house_in.glb" house 35,20 1.7 --signal ao
sheet "$work/car_in.glb" car 35,20 4 --signal shadow --light-angle 4
sheet "$work/seat_in.glb" seat 35,15 1 --signal indirect --quality draft --occluders "$work/room.glb"

# Real scenes.
sheet data/cornell.glb cornell front 1.2 --signal lightmap --quality draft
sheet "$scenes/lights_punctual_lamp.glb" lamp 35,15 1 --signal lightmap --quality draft --light-radius 0.02
sheet "$scenes/glass_vase_flowers.glb" flowers 35,15 1 --signal lightmap --quality draft
sheet "$scenes/lamborghini_huracan.glb" huracan 35,20 1 --signal shadow+ao --sun 40,45,100000,3
sheet "$scenes/ldraw_island_hopper.glb" ldraw 35,25 1 --signal lightmap --quality draft --sun 40,45 --sky 8000
sheet "$scenes/japanese_bridge_garden.glb" garden 35,30 1.2 --signal lightmap --quality draft --sun 220,35 --sky 8000
sheet "$scenes/dream_apartment.glb" apartment 35,50 1.2 --signal lightmap --quality draft --sun 150,40,60000 --sky 8000
