"""What a lab does with a folder of logs: who comes next, how far a study is, whether a log is proven."""
