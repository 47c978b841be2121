"""One run on many processes: parts of its bodies, integrated separately, and joined output by output."""
