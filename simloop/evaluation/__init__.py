"""How a run is judged: its outcome, its figures and the yardsticks beside them."""
