"""Effects and measures that a scene may call for, one file each; a scene that does not name one has no trace of it.

Ordinary plug-ins: they import nothing of the engine but `thirdbody.plugin`. Forms and sources stand in each file.
"""
