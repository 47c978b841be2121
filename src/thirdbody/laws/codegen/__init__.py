"""Generated modules: contact laws, effects and labellers composed into compiled code."""
