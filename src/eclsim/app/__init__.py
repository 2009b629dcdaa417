"""The bedside page: turn a knob, see the patient. Served by `eclsim app`, for people who do not write Python.

texts     every word on the page
state     what the page shows, as a value: undo, pinned, saved states, links
knobs     what can be turned, and turning it on a case
circuits  the compiled circuit of a case: CRRT lines on switches
engine    beats off the event loop, the newest request first
session   one browser tab: its state, its beats, what it is told
views/    one module for each view, with its component in web/
server    NiceGUI behind the guard: hosts, origins, passwords, sizes, sessions
"""
