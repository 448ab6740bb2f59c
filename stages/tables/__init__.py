"""The tables that stages write: their columns, and the rows that go into them."""
