"""Pictures of the dog with legs: snapshots of a whole walk in one picture, and a film of it.

`pictures` is what the book calls. `poses` tells from a simulated dog where all of its joints were,
`scene` says what is to be seen and from where, `render` has MuJoCo draw it, in a program of its
own, and `sticks` draws it with matplotlib where there is no OpenGL.
"""
