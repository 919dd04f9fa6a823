"""What may go out, and what goes out when something is wrong.

`pilot` decides, by rules without a clock or a socket; `limits` says which commands exist at all;
`clocks` beats; `signals` and `guardian` see to it that a program's end is a stop.
"""
