"""Sources of recorded pictures: folders of photographs, videos, earlier flights."""
