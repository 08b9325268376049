"""Commands about this installation: plugins, schema."""

from minihuman.cli.options import JsonOption, print_json


def plugins(json: JsonOption = False) -> None:
    """List the installed plug-ins.

    For each plug-in, print its group (such as agents, windows or exporters), its name and its package.

    Example: minihuman plugins
    """
    from minihuman.plugins import list_plugins

    found = list(list_plugins())
    if json:
        print_json(found)
        return
    for one in found:
        print(f"{one.group:12} {one.name:14} {one.package:20} {one.where}")


def schema() -> None:
    """Print the JSON Schema for protocol files.

    Text editors can use the schema to complete and check TOML files.

    Example: minihuman schema > minihuman.schema.json
    """
    import json

    from minihuman.experiment.protocol.protocol import build_json_schema

    print(json.dumps(build_json_schema(), indent=1))
