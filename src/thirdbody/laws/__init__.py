"""Contact laws and body effects: the contract, the catalogue, and their composition into compiled code."""
