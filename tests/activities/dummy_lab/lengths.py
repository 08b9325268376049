from minihuman.ext import ExportResult


def export_lengths(chosen, out):
    """Write the number of steps of each episode, one to a line."""
    lengths = [len(included.episode.actions) for included in chosen]
    out.mkdir(parents=True, exist_ok=True)
    path = out / "lengths.txt"
    path.write_text("".join(f"{length}\n" for length in lengths))
    return ExportResult((path,), len(lengths), sum(lengths))
