#!/usr/bin/env bash
# Runs every example, in a scratch folder, as CI does.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

python "$here/room.py" "$scratch/room"
cartier map "$scratch/room" --detector "$here/red_things.py" -o "$scratch/home"
python "$here/arrays.py" "$scratch/room" "$scratch/arrays"
cartier map "$scratch/arrays" --format "$here/arrays.py" --detector "$here/red_things.py" -o "$scratch/same"
cartier show "$scratch/home" --plot "$scratch/home.png"
cartier ask "$scratch/home" "bring me to the red thing" --plot "$scratch/red.png"
python "$here/map_and_ask.py" "$scratch/room" "$here/red_things.py" "where is the red thing?"
python "$here/map_and_ask.py" "$scratch/room" "$here/red_things.py" "I want to play the trombone"
