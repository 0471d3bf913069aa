"""The planner of mode `matching`: one beam search over the film's motion graph."""
