"""Steps of the lead planner: routes, their best mixture, coding as lines, and TLBO."""
