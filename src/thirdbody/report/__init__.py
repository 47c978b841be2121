"""What commands print: tables, checks of a scene, comparisons."""
