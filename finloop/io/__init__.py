"""The only library modules that touch paths: video, tables, cut-outs, whole-or-nothing writing."""
