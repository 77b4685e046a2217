"""Common tools for all packages: errors, checked quantities, files, the terminal, worker pools."""
