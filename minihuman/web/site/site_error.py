"""Errors of sites: protocols that no static folder can run, and records that do not come from one."""

from minihuman.errors import MinihumanError


class SiteError(MinihumanError, ValueError):
    """A protocol cannot run without a server, or a record is not one of the site's."""
