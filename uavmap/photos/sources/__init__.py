"""Where recorded pictures come from: folders of photographs, videos, earlier flights."""
