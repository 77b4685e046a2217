"""Planners that move a point step by step: potential fields and heading-by-heading navigation.

- `rollout`: the base class of planners whose path is the trace of a moving point.
- `potential_field`, `ga_apf`: a point follows the force of an artificial potential field;
  `deformed_field` is the walk of `ga_apf`, `evolution` its genetic algorithm.
- `sensing`, `stepper`, `steering`, `fuzzy`, `online`, `avoa_online`: a point robot chooses a
  heading for each step from what it senses within its range; `heading_search` and
  `controller_search` are the compiled searches.
"""
