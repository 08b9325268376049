from minihuman.report.html import long_table


def test_a_table_of_more_rows_than_anybody_reads_is_folded_up_and_says_how_many_it_has() -> None:
    few = long_table("All.", ("subject", "n"), [(f"sub-{number}", "4") for number in range(60)])
    many = long_table("All.", ("subject", "n"), [(f"sub-{number}", "4") for number in range(61)])
    assert few.startswith("<table>")
    assert many.startswith("<details><summary>61 rows: subject, n</summary><table>")
    assert many.count("<tr>") == 62
