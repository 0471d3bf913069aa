"""Types that every room may use, and that know no file and no method: tables and cut-outs."""
