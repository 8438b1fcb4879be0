"""Many policies in one program; rows, tables and figures of them."""
