"""A dog with legs: a Go2's body and gait, by physics, that speaks the Go1's packets.

`parts` finds body and gait in a package that is installed beside this one, `physics` moves the
body, `gait` walks by a trained policy, `postures` stands, lies and gets up, `odometry` tells from
the legs how far it came, and `dog` puts them together behind the interface of `body.Dog`.
"""
