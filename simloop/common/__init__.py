"""What every package may use: errors, checked quantities, files, the terminal, worker pools."""
