"""The steps of the lead planner: routes, their best mixture, coding as lines, TLBO."""
