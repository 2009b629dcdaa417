"""The bedside page: turn a knob, see the patient. Served by `eclsim app`, for people who do not write Python.

texts       every text of the page
state       what the page shows, as values: undo, links, snapshots that a browser keeps
provenance  where the numbers come from, in words
knobs       what can be turned, and turning it on a case; ranges: reference ranges and limits
display     what the views show of patient and devices; drawing: geometry of the schematic
engine      beats off the event loop; beat, studies: what is computed
session     one browser tab: its state, its beats, what is sent to it; updates: what follows a beat
identify    the form of measurements; fitting, posterior: fits and posteriors
files       what is opened and taken away
page        the page and its header; web/ holds a script for each view
server      NiceGUI behind the guard: hosts, origins, passwords, sizes, sessions
"""
