"""Commands about this installation: plugins, schema."""

from minihuman.cli.options import JsonOption, print_result


def plugins(json: JsonOption = False) -> None:
    """List the installed plug-ins.

    For each plug-in, print its group (such as agents, windows or exporters), its name and its package.

    Example: minihuman plugins
    """
    from minihuman.plugins import list_plugins

    installed = list_plugins()
    lines = (f"{plugin.group:12} {plugin.name:14} {plugin.package:20} {plugin.where}" for plugin in installed)
    print_result(installed, lambda: "\n".join(lines), json=json)


def schema() -> None:
    """Print the JSON Schema for protocol files.

    Text editors can use the schema to complete and check TOML files.

    Example: minihuman schema > minihuman.schema.json
    """
    import json

    from minihuman.experiment.protocol.protocol import build_json_schema

    print(json.dumps(build_json_schema(), indent=1))
