"""What the workflow's rules call: parse, load, call one function, save."""
