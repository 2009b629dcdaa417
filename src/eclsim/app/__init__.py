"""The bedside page: turn a knob, see the patient. Served by `eclsim app`, for people who do not write Python.

texts       the texts of the page, from english.toml
state       state of the page, as values: undo, links, snapshots stored by a browser
provenance  sources of the numbers, in words
knobs       knobs and pickers, and applying them to a case; reference ranges and limits are in display
display     content of the views of patient and devices; drawing: geometry of the schematic
engine      computation off the event loop; beat, studies: the computations
session     one browser tab: its state, its beats and the messages to it; updates: what follows a beat
identify    the form of measurements; fitting, posterior: fits and posteriors
files       opening and saving of files
page        the page and its header; web/ contains a script for each view
server      NiceGUI behind the guard: hosts, origins, proxies, sizes; sign_in: passwords and sessions;
            frames: messages of a browser before they are read; listening: addresses
"""
