"""What the commands do: generators of rows."""
