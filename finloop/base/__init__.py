"""What every room may use and no method is in: schemas of tables, cut-outs, drawings, paint."""
