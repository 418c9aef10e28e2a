"""URScript: text to tokens and syntax tree, tree to closures over a whitelist, run in cycles."""
