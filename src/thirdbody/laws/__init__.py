"""Contact laws and body effects: the contract, the built-in laws, and their composition into compiled code."""
